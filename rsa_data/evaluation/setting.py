"""What an evaluation works on: datasets with the split, the tables that belong to a head, rules."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from .. import registry
from ..common.errors import RsaDataError, UsageError, unknown
from ..datasets import index
from ..datasets.found_samples import check_once
from ..heads.belong import Source, Tables
from ..heads.sources import sources as find_sources
from ..runner.commands import again
from ..store.tables import WorkDir
from . import protocols
from .inputs import TestPart
from .protocols import Rules

if TYPE_CHECKING:
    from ..heads.description import Description


def with_split(work: WorkDir, datasets: Sequence[str], split: str) -> list[str]:
    """The datasets asked for, or all of the work dir that have the split.

    Raises UsageError for one that is not there, RsaDataError when none has the split.
    """
    there = work.datasets()
    for name in datasets:
        if name not in there:
            raise unknown("dataset in this work dir", name, there)
    for name in _splits(split)[1]:
        if name not in there:
            raise unknown("dataset in --split", name, there)
    splits = {}
    for name in datasets or there:
        samples = work.table(name, "samples")
        splits[name] = {samples.receipt(n).split for n in samples.parts()}
    chosen = [name for name, has in splits.items() if split_of(split, name) in has]
    if missing := sorted(set(datasets) - set(chosen)):
        found = ", ".join(sorted(splits[missing[0]]))
        raise RsaDataError(
            f"{missing[0]}: expected the split {split_of(split, missing[0])!r}; found {found}"
        )
    if not chosen:
        raise RsaDataError(
            f"{work.store.location}: no dataset there has the split {split!r}: index one with "
            "`rsa-data captions --dataset NAME`"
        )
    return chosen


def tables_of(work: WorkDir, about: "Description", wanted: Tables) -> dict[str, Source]:
    """The tables of each dataset that the head described by `about` can be measured with.

    wanted : datasets; and style and depth model where the head does not say (an imported one), and
    several are there.
    Raises RsaDataError when tables are missing, or made otherwise than those it was trained on; an
    imported head is held to what is known of it.
    """
    from ..heads import belong

    features, depth = about.features, about.depth
    architecture = registry.resolve("head", registry.HEADS, about.name)
    reads = architecture.reads or belong.kinds_of(features)
    tables = replace(
        wanted,
        style=features.style or wanted.style,
        encoder=features.encoder,
        depth_model=depth.model or wanted.depth_model,
    )
    sources = find_sources(work, tables, about.name, reads)
    for source in sources:
        own = work.table(source.dataset, source.depth)
        first = source.inputs[0]
        _same(
            "head and embeddings",
            features.identity(),
            f"{source.dataset}/{first.table}",
            belong.features_of(work, source).identity(),
        )
        found, geometry = belong.depth_identity(own)
        said = msgspec.to_builtins(depth)
        trained_at = said.pop("geometry").get(source.dataset)
        _same("head and depth", said, str(own), found)
        if trained_at is not None:
            belong.same("head and depth", {"the head": trained_at, str(own): geometry})
    return {source.dataset: source for source in sources}


def _same(kind: str, wanted: dict[str, Any], where: str, found: dict[str, Any]) -> None:
    """Raises RsaDataError unless both are the same in all that the head says of itself."""
    from ..heads import belong

    if any(value is None for value in wanted.values()):
        wanted = {key: value for key, value in wanted.items() if value is not None}
        found = {key: found.get(key) for key in wanted}
        if "options" in wanted:
            found["options"] = {k: v for k, v in found["options"].items() if k in wanted["options"]}
    belong.same(kind, {"the head": wanted, where: found})


def split_of(split: str, dataset: str) -> str:
    """The split of a dataset by what --split says, such as test or test,ddad=val."""
    usual, own = _splits(split)
    return own.get(dataset, usual)


def _splits(split: str) -> tuple[str, dict[str, str]]:
    """The usual split, and those of single datasets."""
    usual, *others = split.split(",")
    own = {name: value for name, _, value in (other.partition("=") for other in others)}
    if "" in own.values() or "=" in usual:
        raise UsageError(f"--split: expected SPLIT or SPLIT,DATASET=SPLIT; found {split!r}")
    return usual, own


def rules_of(
    work: WorkDir, name: str, protocol: str, beyond: Literal["far", "near"] = "far"
) -> Rules:
    """The protocol's rules for a dataset of the work dir."""
    kind = work.table(name, "samples").description().options["dataset"]
    rules = protocols.protocol(protocol).of(index.load_dataset(work, name), kind)
    return replace(rules, beyond=beyond)


def parts_of(work: WorkDir, name: str, depth: str, split: str) -> list[TestPart]:
    """The parts of a split, see `split_of`, in order.

    Raises RsaDataError where depth is not done for all, or an image stands there twice.
    """
    split = split_of(split, name)
    samples, table = work.table(name, "samples"), work.table(name, depth)
    numbers = [n for n in samples.parts() if samples.receipt(n).split == split]
    if missing := set(numbers) - set(table.parts()):
        raise RsaDataError(
            f"{table}: {len(missing)} of {len(numbers)} parts of the {split} split are not done. "
            f"Run `{again(work, table, f' --split {split}')}`"
        )
    check_once(samples, numbers)
    return [TestPart(work, name, n, depth) for n in numbers]


def segments_of(work: WorkDir, source: Source) -> str | None:
    """The segments table that a head's captions or objects were made from; None where imported."""
    for feed in source.inputs:
        table = work.table(source.dataset, feed.captions or feed.table)
        for name in table.description().inputs:
            if name.startswith("segments/"):
                return name
    return None
