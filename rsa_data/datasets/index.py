"""The samples table: which images a dataset has, cut into the parts that all later tables share."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from .. import registry
from ..common import options as option_binding
from ..common.errors import RsaDataError, UsageError
from ..store import schemas
from ..store.table_names import check_dataset_name
from ..store.tables import Description, Made, WorkDir, fingerprint
from . import left_out
from .dataset import Dataset
from .roots import is_remote, open_root


def open_dataset(choice: str, given: Mapping[str, Any]) -> tuple[Dataset, dict[str, Any]]:
    """The dataset `NAME`, or `BUILDER:NAME` for a builder under a name of one's own.

    Returns it with what the samples table keeps, from which `load_dataset` opens it again.
    """
    builder, name = registry.DATASETS.split(choice)
    name = name or builder.rpartition(":")[2]
    check_dataset_name(name)
    build = registry.resolve("dataset", registry.DATASETS, builder)
    known = option_binding.parameters(_part_sizes)
    sizes = {k: v for k, v in given.items() if k.replace("-", "_") in known}
    sizes = option_binding.bind(_part_sizes, sizes, f"dataset {builder}")
    given = {k: v for k, v in given.items() if k.replace("-", "_") not in known}
    for option, value in sizes.items():
        if value < 1:
            raise UsageError(f"dataset {builder}: {option}: expected 1 or more, found {value}")
    bound = option_binding.bind(build, given, f"dataset {builder}")
    plain = {
        k: v if isinstance(v, (int, float, bool, type(None))) else str(v) for k, v in bound.items()
    }
    return replace(build(**bound), name=name), {
        "dataset": builder,
        **plain,
        **sizes,
    }


def _part_sizes(*, part_size: int = 2000, test_part_size: int = 100) -> None:
    """Options that every dataset has.

    Parameters
    ----------
    part_size : images in a part of a training split; what a killed worker loses at most.
    test_part_size : images in a part of a test split, whose depth maps are stored whole.
    """


def load_dataset(work: WorkDir, name: str) -> Dataset:
    """The dataset that a work dir has under `name`, with the options it was indexed with."""
    kept = dict(work.table(name, "samples").description().options)
    builder = kept.pop("dataset")
    known = option_binding.parameters(registry.resolve("dataset", registry.DATASETS, builder))
    return open_dataset(f"{builder}:{name}", {k: v for k, v in kept.items() if k in known})[0]


def find_root(work: WorkDir, name: str, given: Path | None = None) -> Path | None:
    """Where a dataset's files lie: --root, RSA_DATA_NAME_ROOT, where they lay last, data/NAME.

    None when there is no such folder and none was asked for by name.
    """
    variable = f"RSA_DATA_{name.upper().replace('-', '_')}_ROOT"
    wanted = given or (open_root(os.environ[variable]) if os.environ.get(variable) else None)
    if wanted is not None:
        return wanted
    if (last := work.store.read(f"{name}/root.txt")) is not None:
        root = open_root(last.decode())
        if is_remote(root) or root.is_dir():
            return root
    return Path("data") / name if (Path("data") / name).is_dir() else None


def missing_root(dataset: Dataset) -> RsaDataError:
    """The error for a dataset whose files are needed and cannot be found."""
    variable = f"RSA_DATA_{dataset.name.upper().replace('-', '_')}_ROOT"
    page = dataset.name if dataset.name in registry.DATASETS else "folder"
    return RsaDataError(
        f"dataset {dataset.name}: expected its files at data/{dataset.name}; no such folder. Give "
        f"--root DIR or set {variable}. `rsa-data list datasets {page}` says where to get it "
        "and how its files must lie"
    )


@dataclass(frozen=True)
class Indexed:
    """What `index` did: samples there, those that are new, and a line on files left out."""

    samples: int
    new: int
    left_out: str | None


def index(
    work: WorkDir,
    dataset: Dataset,
    kept: Mapping[str, Any],
    *,
    root: Path | None,
    samples: pa.Table | None = None,
    part_size: int,
    test_part_size: int,
) -> Indexed:
    """Writes the samples that the work dir does not have yet, as new parts after the old ones.

    Parameters
    ----------
    samples : the index when it does not come from files under `root`.
    part_size, test_part_size : see `_part_sizes`.

    A part holds one split.
    """
    if samples is None:
        if root is None:
            raise missing_root(dataset)
        samples = dataset.index(root, None)
        place = root if is_remote(root) else root.resolve()
        work.store.write(f"{dataset.name}/root.txt", str(place).encode())
    beside = left_out.told(samples)
    samples = _named(samples, dataset.name)
    table = work.table(dataset.name, "samples")
    sizes = {"part_size": part_size, "test_part_size": test_part_size}
    builder = str(kept.get("dataset", ""))
    source = registry.DATASETS.source(builder) if builder in registry.DATASETS else None
    description = Description(
        identity=source or msgspec.UNSET,
        stage="index",
        stage_version=1,
        schema="samples",
        schema_version=schemas.definition("samples")["version"],
        options={**kept, **sizes},
    )
    table.bind(description)
    # Listed once: were the next number taken from a second look, a run beside this one that had
    # written a part in between would leave its samples there twice.
    done, files = table.parts(), set(table.store.list(table.path))
    gone = {receipt.part for receipt in table.receipts(done) if receipt.file not in files}
    there = [number for number in done if number not in gone]
    old = [table.read(number, columns=["sample_id"]) for number in there]
    known = pa.concat_tables(old)["sample_id"] if old else pa.chunked_array([[]], pa.string())
    fresh = samples.filter(pc.invert(pc.is_in(samples["sample_id"], value_set=known)))
    # Numbers of parts that were lost come first: their samples are the first ones that are new.
    end = max(done, default=-1) + 1
    numbers = chain(sorted(set(range(end)) - set(there)), count(end))
    if len(fresh):
        table.forget_manifest()
    for split in sorted(pc.unique(fresh["split"]).to_pylist(), key=lambda s: (s != "train", s)):
        rows = fresh.filter(pc.equal(fresh["split"], split))
        size = test_part_size if split in dataset.test_splits else part_size
        for start, stop in _cuts(rows, size, dataset):
            part = rows.slice(start, stop - start)
            follows = sample_fingerprint(dataset.name, schemas.digest(part))
            made = Made(ok=len(part), failed=0, skipped=0, split=split, fingerprint=follows)
            number = next(numbers)
            table.commit(number, part, made, redo=number in gone)
    table.manifest(table.parts())
    return Indexed(len(known) + len(fresh), len(fresh), beside)


def sample_fingerprint(dataset: str, digest: str) -> str:
    """What a part of samples follows from: itself; digest : of its content."""
    return fingerprint({"dataset": dataset, "digest": digest})


def _cuts(rows: pa.Table, size: int, dataset: Dataset) -> Iterator[tuple[int, int]]:
    """First and last row, last excluded, of each part: so many rows at most, of one shard."""
    ends = [len(rows)]
    if dataset.shard is not None:
        shards = [dataset.shard(path or "") for path in rows["image"].to_pylist()]
        ends = [i for i in range(1, len(shards)) if shards[i] != shards[i - 1]] + ends
    begin = 0
    for end in ends:
        for start in range(begin, end, size):
            yield start, min(start + size, end)
        begin = end


def _named(samples: pa.Table, name: str) -> pa.Table:
    """Samples under the dataset's name in the work dir, in the order of their ids."""
    tails = pc.replace_substring_regex(samples["sample_id"], "^[^/]*/", "")
    columns = {c: samples[c] for c in samples.column_names}
    columns["sample_id"] = pc.binary_join_element_wise(pa.scalar(name), tails, "/")
    columns["dataset"] = pa.array([name] * len(samples), pa.string())
    table = schemas.from_columns("samples", columns)
    if len(table) != pc.count_distinct(table["sample_id"]).as_py():
        raise RsaDataError(f"dataset {name}: two samples have the same sample_id")
    return table
