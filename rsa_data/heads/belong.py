"""Which tables belong together: what a head's features and relative depth are made of."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import registry
from ..common.errors import RsaDataError, UsageError, unknown
from ..store.tables import Table, WorkDir, fingerprint
from .description import Features
from .inputs import kinds
from .inputs.kinds import Block, Feed

# Options of the depth stage that change how fast something is computed or kept, or which pixels
# are drawn, but not what it means.
_INDIFFERENT = ("threads", "store", "runtime", "device", "pixels", "seed")
# Options of the depth stage that may differ from dataset to dataset within one head: the paper's
# own models see NYU and KITTI images at different sizes.
_PER_DATASET = ("geometry", "crop")


@dataclass(frozen=True)
class Tables:
    """Which tables of the work dir to learn from or to measure on.

    datasets : datasets of the work dir; none means all.
    style : caption style, needed when there are several.
    encoder : encoder, needed when there are several; for a head that reads several inputs one for
        each, as TEXT+IMAGE.
    depth_model : relative-depth model, needed when there are several.
    """

    datasets: tuple[str, ...] = ()
    style: str | None = None
    encoder: str | None = None
    depth_model: str | None = None


@dataclass(frozen=True)
class Source:
    """The tables of one dataset that a head learns from or is measured on.

    inputs : in the order in which their rows stand side by side.
    """

    dataset: str
    depth: str
    inputs: tuple[Feed, ...]

    @property
    def captions(self) -> str:
        """The captions table of the first input that has one, or nothing."""
        return next((feed.captions for feed in self.inputs if feed.captions), "")

    @property
    def tables(self) -> list[str]:
        """Names of all tables, samples first and depth last."""
        names = ["samples", *(table for feed in self.inputs for table in feed.tables), self.depth]
        return list(dict.fromkeys(names))

    def read(self, work: WorkDir, number: int, variant: int | None = None) -> list[Block]:
        """Each input of every row of samples of a part; see `Feed.read`."""
        return [feed.read(work, self.dataset, number, variant) for feed in self.inputs]


def features_of(work: WorkDir, source: Source) -> Features:
    """What the features of a source are: of its first input, and of those beside it."""
    first, *others = [feed.identity(work, source.dataset) for feed in source.inputs]
    encoder = "+".join(str(one["encoder"]) for one in (first, *others))
    values = {**first, "encoder": encoder} | ({"beside": others} if others else {})
    return Features.of(values)


def kinds_of(features: Features) -> tuple[str, ...]:
    """Which kinds of input features are, in their order."""
    beside = features.beside or []
    return tuple(kinds.of_style(one.style) for one in (features, *beside))


def depth_identity(table: Table) -> tuple[dict[str, Any], dict[str, Any]]:
    """What y is: (model, its options and files; the geometry this dataset's images had)."""
    description = table.description()
    options = {k: v for k, v in description.options.items() if k not in _INDIFFERENT}
    geometry = {key: options.pop(key, None) for key in _PER_DATASET}
    model = {
        "model": table.name.partition("/")[2],
        "options": options,
        "files": description.files,
        "stage_version": description.stage_version,
    }
    return model, geometry


def same(kind: str, found: Mapping[str, Mapping[str, Any]]) -> Mapping[str, Any]:
    """The identity that all have; found: where -> identity. Raises RsaDataError otherwise.

    What is None in the first is not known there (an imported head) and goes with anything.
    """
    (first, identity), *others = found.items()
    for where, other in others:
        for key in identity.keys() | other.keys():
            mine, theirs = identity.get(key), other.get(key)
            if key == "options" and mine and theirs:
                # An option that a head does not know of came after it, or was not recorded.
                theirs = {name: theirs.get(name) for name in mine}
            if mine is not None and mine != theirs:
                raise RsaDataError(
                    f"{kind} that do not belong together: {key} is {mine!r} in "
                    f"{first} and {theirs!r} in {where}. Make them again with the same "
                    "options, or train on one dataset at a time with --datasets"
                )
    return identity


def sources(work: WorkDir, tables: Tables, head: str, reads: Sequence[str]) -> list[Source]:
    """The tables to learn from, one entry a dataset; what is not named must be the only one there.

    head, reads : name of the head, for messages, and the kinds of input that its class declares.

    Raises UsageError when a choice is open, RsaDataError when a table is missing.
    """
    there = work.datasets()
    for name in tables.datasets:
        if name not in there:
            raise unknown("dataset in this work dir", name, there)
    if not there:
        raise RsaDataError(
            f"{work.store.location}: no dataset there yet. Begin with "
            "`rsa-data captions --dataset NAME`, or name another --work"
        )
    if reads and tables.style and not _has_style(reads, tables.style):
        raise UsageError(f"--head {head} reads {' and '.join(reads)}; found --style {tables.style}")
    found = []
    for name in tables.datasets or there:
        names = work.tables(name)
        depths = [t for t in names if t.startswith("depth/")]
        depth = _only(
            name,
            "depth",
            [t for t in depths if tables.depth_model in (None, t.partition("/")[2])],
            "--depth-model",
            f"rsa-data depth --dataset {name}",
        )
        found.append(Source(name, depth, tuple(_inputs(name, names, tables, reads))))
    return found


def _has_style(reads: Sequence[str], style: str) -> bool:
    folders = {name: kinds.kind(name).folder for name in registry.INPUTS}
    if style in folders.values():
        return "text" not in reads and any(folders[name] == style for name in reads)
    return "text" in reads


def _inputs(dataset: str, names: Sequence[str], tables: Tables, reads: Sequence[str]) -> list[Feed]:
    """The inputs of a head on one dataset whose tables are `names`."""
    encoders: list[str | None] = [*(tables.encoder.split("+") if tables.encoder else [])]
    if not reads and len(encoders) == 2:
        reads = ("text", "image")
    if len(encoders) > max(len(reads), 1):
        raise UsageError(
            f"--encoder {tables.encoder}: expected one for each of {', '.join(reads) or 'text'}"
        )
    # One encoder for several inputs is the first one's; the others must be the only ones there.
    encoders += [None] * (max(len(reads), 1) - len(encoders))
    feeds = [kinds.feed(table) for table in names if table.startswith("embeddings/")]
    if not reads:
        vectors = [feed for feed in feeds if kinds.kind(feed.kind).vector]
        good = [f for f in vectors if tables.style in (None, f.style)]
        return [_chosen(dataset, good, encoders[0], "rsa-data embed")]
    found = []
    for name, encoder in zip(reads, encoders, strict=True):
        own = kinds.kind(name)
        if own.table:
            found.append(Feed(name, own.table))
            continue
        good = [feed for feed in feeds if feed.kind == name]
        if name == "text":
            good = [feed for feed in good if tables.style in (None, feed.style)]
        found.append(_chosen(dataset, good, encoder, own.made_by))
    return found


def _chosen(dataset: str, feeds: list[Feed], encoder: str | None, make: str) -> Feed:
    by_name = {feed.table: feed for feed in feeds if encoder in (None, feed.encoder)}
    return by_name[_only(dataset, "embeddings", list(by_name), "--style and --encoder", make)]


def _only(dataset: str, kind: str, found: list[str], by: str, make: str) -> str:
    if not found:
        raise RsaDataError(f"{dataset}: no such {kind} table. Make it first: {make}")
    if len(found) > 1:
        names = ", ".join(name.partition("/")[2] for name in found)
        raise UsageError(f"{dataset}: several {kind} tables; say which by {by}: {names}")
    return found[0]


def current(work: WorkDir, source: Source, number: int) -> dict[str, str]:
    """Digests of the part in each table of a source, by table.

    Raises RsaDataError when a table has no such part yet, or made it from another part than the
    one that lies there now.
    """
    receipts = {name: work.table(source.dataset, name).receipt(number) for name in source.tables}
    for name, receipt in receipts.items():
        for input_name, digest in receipt.inputs.items():
            if input_name in receipts and receipts[input_name].digest != digest:
                raise RsaDataError(
                    f"{source.dataset}/{name} part {number} was made from another {input_name} "
                    "part than the one that lies there now: run its stage again"
                )
    return {name: receipt.digest for name, receipt in receipts.items()}


def together(digests: list[dict[str, str]]) -> dict[str, str]:
    """One digest a table of the digests of its parts, in the order given."""
    return {name: fingerprint([part[name] for part in digests]) for name in digests[0]}


def encode(features: Any, captions: Sequence[str], weights: Any = None) -> np.ndarray:
    """Features of captions, (n, dim), by the encoder that a head was trained on.

    features : `features` of head.json. weights : the encoder's file, where it is not found alone.
    """
    return encoder(features, weights)(captions)


def encoder(features: Any, weights: Any = None) -> Callable[[Sequence[str]], np.ndarray]:
    """`encode` with the encoder in memory; raises RsaDataError when it is not the head's."""
    from ..common.digests import file_sha256
    from ..embeddings import embed

    if not isinstance(features, Features):
        features = Features.of(features)
    if features.beside or kinds.of_style(features.style) != "text":
        raise UsageError(
            f"this head reads {features.style} features of {features.encoder}, not captions "
            "alone: call rsa_data.ScaleHead.load(...)(features) with the features of its tables"
        )
    options = {**(features.options or {}), "encoder_weights": weights}
    paths = embed.files(**options)
    for name, path in paths.items():
        known = (features.files or {}).get(name)
        if known is not None and (found := file_sha256(str(path))) != known:
            raise RsaDataError(
                f"encoder {features.encoder}: the head was trained with another file {name}: "
                f"expected sha256 {known}; found {found} in {path.name}"
            )
    loaded: Callable[[Sequence[str]], np.ndarray] = embed.loaded(**options)
    return loaded
