"""Which shards lie below a root, the samples of each, and the split that a shard's name says."""

import re
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ..common.errors import RowError, RsaDataError
from ..common.prefetch import ahead
from ..store import schemas
from .dataset import Shards
from .found_samples import FoundSamples
from .listing import Sample, files_below, nothing_found, paths, require_folder, to_table
from .roots import RemotePath, is_remote

# The hub's own Parquet copies of large sets lie in folders such as partial-train.
_SPLIT = re.compile(r"(?:.*/)?(?:partial-)?(train|test|val)(?:idation)?(?:[-_./].*)?\.\w+")


# Shards that are read at once where they are far.
_AT_ONCE = 16

# Samples that are Python's objects at one time, each some hundred bytes more than in a table.
_IN_MEMORY = 4096


def find_shards(name: str, root: Path, *, suffix: str, listed: Path | None) -> list[str]:
    """Paths of the shards below a root, sorted; raises RsaDataError when there is none."""
    if listed is not None:
        found = sorted({path for _, path in paths(listed, name)})
    else:
        require_folder(name, root)
        files = [below + file for below, names in files_below(root) for file in names]
        found = sorted(file for file in files if file.endswith(suffix))
        if not found:
            others = ", ".join(sorted(files)[:4]) or "no file"
            raise RsaDataError(
                f"{name}: {root}: expected shards *{suffix} in it, found {others}"
                + ("; unpack them first: what is packed cannot be read from the middle"
                   if any(suffix + "." in file for file in files) else "")
            )  # fmt: skip
    return found


def split_of(shard: str) -> str:
    """The split that a shard's folder or name says; train where they say none."""
    match = _SPLIT.fullmatch(shard)
    return match[1] if match else "train"


def shard_table(name: str, root: Path, samples: Iterable[Sample]) -> pa.Table:
    """The samples of one shard, those of a split in its order; it may hold none."""
    waiting, tables = iter(samples), [schemas.schema("samples").empty_table()]
    while some := list(islice(waiting, _IN_MEMORY)):
        tables.append(to_table(name, root, some, None, in_order=True))
    table = pa.concat_tables(tables)
    if pc.count_distinct(table["split"]).as_py() < 2:
        return table
    return table.take(pc.sort_indices(table, [("split", "ascending")]))  # stable


def index_of(name: str, shards: Shards, root: Path, split: str | None) -> pa.Table:
    """All shards in one table, sorted by split and then by shard: `Dataset.index` of shards."""
    with FoundSamples(name) as found:
        for table in read_shards(shards, root, shards.find(root)):
            found.add(table)
        found.finish()
        none = np.empty(0, "S1")
        splits = [s for s in sorted(found.splits) if split in (None, s)]
        tables = [table for s in splits for table in found.new(s, none, _IN_MEMORY)]
    if not tables:
        raise nothing_found(name, root, split)
    return pa.concat_tables(tables)


def read_shards(shards: Shards, root: Path, names: list[str]) -> Iterator[pa.Table]:
    """The samples of each shard, a table each, in order; far ones are read ahead."""
    read = partial(shards.read, root)
    if not is_remote(root):
        yield from map(read, names)
        return
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        for table in ahead(pool, read, names, _AT_ONCE):
            if isinstance(table, RowError):
                raise table
            yield table


def shard_sizes(root: Path, names: list[str]) -> dict[str, int]:
    """Bytes of each shard; raises RsaDataError for one that is not there."""

    def size(name: str) -> int:
        path = root / name
        try:
            return path.size() if isinstance(path, RemotePath) else path.stat().st_size
        except FileNotFoundError as error:
            raise RsaDataError(f"{path}: expected a shard, found no such file") from error

    with ThreadPoolExecutor(_AT_ONCE if is_remote(root) else 1) as pool:
        return dict(zip(names, pool.map(size, names), strict=True))
