"""The samples table: which images a dataset has, cut into the parts that all later tables share."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa

from .. import registry
from ..common import options as option_binding
from ..common.errors import RsaDataError
from ..common.forms import found, is_path
from ..common.ranges import Positive
from ..store import schemas
from ..store.table_names import check_dataset_name
from ..store.tables import Description, Made, Table, WorkDir, fingerprint
from . import left_out
from .dataset import Dataset
from .found_samples import FoundSamples, known_ids
from .listing import nothing_found
from .roots import is_remote, open_root
from .shard_listing import read_shards, shard_sizes


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
    bound = option_binding.bind(build, given, f"dataset {builder}")
    plain = {
        k: v if isinstance(v, (int, float, bool, type(None))) else str(v) for k, v in bound.items()
    }
    return replace(option_binding.call(build, **bound), name=name), {
        "dataset": builder,
        **plain,
        **sizes,
    }


def _part_sizes(*, part_size: Positive = 2000, test_part_size: Positive = 100) -> None:
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
        # What is not UTF-8 becomes characters that do not print.
        text = last.decode("utf-8", "surrogateescape")
        if not (text.isprintable() and (is_path(text) or "://" in text)):
            raise RsaDataError(
                f"{work.store.location}/{name}/root.txt: expected where the dataset's files lie; "
                f"found {found(text)}. Give --root PLACE"
            )
        root = open_root(text)
        if is_remote(root) or root.is_dir():
            return root
    return Path("data") / name if (Path("data") / name).is_dir() else None


def root_of(work: WorkDir, dataset: Dataset, given: Path | None) -> Path | None:
    """As find_root, or else the address that the dataset itself has."""
    found = find_root(work, dataset.name, given)
    return open_root(dataset.address) if found is None and dataset.address else found


def missing_root(dataset: Dataset) -> RsaDataError:
    """The error for a dataset whose files are needed and cannot be found."""
    variable = f"RSA_DATA_{dataset.name.upper().replace('-', '_')}_ROOT"
    page = dataset.name if dataset.name in registry.DATASETS else "folder"
    return RsaDataError(
        f"dataset {dataset.name}: expected its files at data/{dataset.name}; no such folder. Give "
        f"--root DIR or set {variable}. `rsa-data list datasets {page}` says where to get it "
        "and how its files must lie"
    )


def index(
    work: WorkDir,
    dataset: Dataset,
    kept: Mapping[str, Any],
    *,
    root: Path | None,
    samples: pa.Table | None = None,
    part_size: int,
    test_part_size: int,
) -> str | None:
    """Writes the samples that the work dir does not have yet, as new parts after the old ones.

    Parameters
    ----------
    samples : the index when it does not come from files under `root`.
    part_size, test_part_size : see `_part_sizes`.

    A part holds one split. Shards that are as long as when the index last ended are not read
    again. Nothing is written unless everything that was found is whole.

    Returns a line on files left out, or None.
    """
    table = work.table(dataset.name, "samples")
    place, shards = None, dict[str, int]()
    if samples is None:
        if root is None:
            raise missing_root(dataset)
        place = str(root if is_remote(root) else root.resolve())
        if dataset.shards is not None:
            shards = shard_sizes(root, dataset.shards.find(root))
        last = _remembered(table, place)
        fresh = [shard for shard, size in shards.items() if last.get(shard) != size]
        tables = _tables(dataset, root, fresh)
    else:
        tables, fresh = iter([samples]), []
    beside = None
    with FoundSamples(dataset.name) as found:
        for listed in tables:
            beside = beside or left_out.told(listed)
            found.add(listed)
        found.finish()
        if root is not None and not found.images and len(fresh) == len(shards):
            if found.splits:
                raise RsaDataError(
                    f"{dataset.name}: {root}: expected images, found none: "
                    f"{beside or 'every sample is without one'}"
                )
            raise nothing_found(dataset.name, root, None)
        if place is not None:
            work.store.write(f"{dataset.name}/root.txt", place.encode())
        _bind(table, kept, part_size, test_part_size)
        _append(table, dataset, found, part_size, test_part_size)
    if shards:
        table.remember({"root": place, "shards": shards})
    return beside


def _tables(dataset: Dataset, root: Path, shards: list[str]) -> Iterator[pa.Table]:
    """The samples below a root; of datasets in shards, those of these shards, a table each."""
    if dataset.shards is not None:
        yield from read_shards(dataset.shards, root, shards)
    else:
        yield dataset.index(root, None)


def _remembered(table: Table, place: str) -> dict[str, int]:
    """Bytes of the shards below a root that the table has whole; they need not be read again."""
    if not table.complete() or _gone(table, table.parts()):
        return {}
    last = table.remembered()
    shards = last.get("shards")
    return shards if last.get("root") == place and isinstance(shards, dict) else {}


def _gone(table: Table, done: list[int]) -> set[int]:
    """Parts that are done and whose data is not there any more."""
    files = set(table.store.list(table.path))
    return {receipt.part for receipt in table.receipts(done) if receipt.file not in files}


def _bind(table: Table, kept: Mapping[str, Any], part_size: int, test_part_size: int) -> None:
    builder = str(kept.get("dataset", ""))
    source = registry.DATASETS.source(builder) if builder in registry.DATASETS else None
    description = Description(
        identity=source or msgspec.UNSET,
        stage="index",
        stage_version=1,
        schema="samples",
        schema_version=schemas.definition("samples")["version"],
        options={**kept, "part_size": part_size, "test_part_size": test_part_size},
    )
    table.bind(description)


def _append(
    table: Table, dataset: Dataset, found: FoundSamples, part_size: int, test_part_size: int
) -> None:
    """Writes the samples that the table does not have, in parts of one split and one shard."""
    # Listed once: were the next number taken from a second look, a run beside this one that had
    # written a part in between would leave its samples there twice.
    done = table.parts()
    gone = _gone(table, done)
    there = [number for number in done if number not in gone]
    known = known_ids(table.read(number, columns=["sample_id"]) for number in there)
    # Numbers of parts that were lost come first: their samples are the first ones that are new.
    end = max(done, default=-1) + 1
    numbers = chain(sorted(set(range(end)) - set(there)), count(end))
    begun = False
    for split in sorted(found.splits, key=lambda s: (s != "train", s)):
        size = test_part_size if split in dataset.test_splits else part_size
        for part in found.new(split, known, size):
            if not begun:
                table.forget_manifest()
                begun = True
            follows = sample_fingerprint(dataset.name, schemas.digest(part))
            made = Made(ok=len(part), failed=0, skipped=0, split=split, fingerprint=follows)
            number = next(numbers)
            table.commit(number, part, made, redo=number in gone)
    table.manifest(table.parts())


def sample_fingerprint(dataset: str, digest: str) -> str:
    """What a part of samples follows from: itself; digest : of its content."""
    return fingerprint({"dataset": dataset, "digest": digest})
