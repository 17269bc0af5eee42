"""`evaluate`: a head on the test splits, beside what bounds it and what it must beat."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from .. import index, registry
from ..errors import RsaDataError
from ..parts import Work
from . import output
from .constants import fit_constants
from .inputs import TestPart
from .methods import Method, by_constant, by_head, oracle_methods
from .protocols import PROTOCOLS, Rules, rules
from .rows import measure
from .summary import Row, summarise

if TYPE_CHECKING:
    from ..heads.checkpoint import ScaleHead
    from ..heads.examples import Source


@dataclass(frozen=True)
class Evaluation:
    """What an evaluation found.

    table : a row for each image and method, schemas/metrics.toml. rows : means over images.
    summary : text for a terminal. folder : where all of it was written, in the work dir.
    """

    table: pa.Table
    rows: Sequence[Row]
    summary: str
    folder: str


def evaluate(
    work: Work,
    bar: Callable[[str, int], Any] | None = None,
    *,
    head: str = "head",
    datasets: tuple[str, ...] = (),
    beside: tuple[str, ...] = (),
    protocol: str = "rsa",
    split: str = "test",
    draws: int = 1000,
) -> Evaluation:
    """Measures a head on whole maps of the test splits, beside oracles and constants.

    Parameters
    ----------
    head : name of a head in the work dir.
    datasets : datasets of the work dir; none means all that have the split. One that the head was
        not trained on is measured too and marked zero-shot.
    beside : further heads of the work dir to measure in the same table, such as controls.
    protocol : crops, depth range and scaling; rsa, bts, monodepth2 or depth-anything.
    split : what to evaluate on; its depth must be stored as whole maps.
    draws : resamplings of scenes for the confidence intervals; 0 for none.

    Writes the metrics of each image (Parquet) and the summary (Markdown, LaTeX, CSV) to
    WORK/heads/NAME/evaluation/PROTOCOL. Raises RsaDataError when tables are missing or do not
    belong to the head, UsageError for unknown names.
    """
    from ..heads.checkpoint import ScaleHead

    if protocol not in PROTOCOLS:
        raise registry.unknown("protocol", protocol, PROTOCOLS)
    loaded = ScaleHead.load(f"{work.store.location}/heads/{head}")
    about = loaded.description
    sources = tables_of(work, about, with_split(work, datasets, split))
    ranges = {name: rules_of(work, name, protocol) for name in sources}
    depths = {name: source.depth for name, source in sources.items()}
    limits = {name: (rule.min_depth, rule.max_depth) for name, rule in ranges.items()}
    others = {name: ScaleHead.load(f"{work.store.location}/heads/{name}") for name in beside}
    for other in others.values():
        tables_of(work, other.description, list(sources))
    constants = fit_constants(work, depths, limits, about.get("datasets", {}))
    found = []
    for name, source in sources.items():
        methods: dict[str, Method] = {
            label_of(name, other): head_method(other, source)
            for name, other in {"head": loaded, **others}.items()
        }
        methods |= {
            **{label: by_constant(*pair) for label, pair in constants[name].items()},
            **oracle_methods(ranges[name].max_depth),
        }
        parts = parts_of(work, name, source.depth, split)
        found.append(measure(parts, methods, ranges[name], bar))
    table = pa.concat_tables(found)
    rows = summarise(table, draws)
    folder = f"heads/{head}/evaluation/{protocol}"
    title = f"head {head}: protocol {protocol}, {split} split"
    summary = output.write(work, folder, table, rows, title, notes(about, rows, protocol))
    return Evaluation(table, rows, summary, folder)


_CONTROLS = {"shuffled": "captions shuffled", "dataset": "dataset name only"}


def label_of(name: str, head: "ScaleHead") -> str:
    """What a table calls a head: its name, or what kind of control it is."""
    return _CONTROLS.get(head.description.get("options", {}).get("control", "none"), name)


def head_method(head: "ScaleHead", source: "Source") -> Method:
    """A head on a dataset's tables; a control sees no more than it was trained to see."""
    from ..heads.controls import controlled_features

    options = head.description.get("options", {})
    see = partial(
        controlled_features,
        control=options.get("control", "none"),
        seed=options.get("seed", 0),
        dataset=source.dataset,
        datasets=list(head.description.get("datasets", {})),
    )
    return by_head(head, source.embeddings, source.captions or None, see=see)


def with_split(work: Work, datasets: Sequence[str], split: str) -> list[str]:
    """The datasets asked for, or all of the work dir that have the split.

    Raises UsageError for one that is not there, RsaDataError when none has the split.
    """
    there = work.datasets()
    for name in datasets:
        if name not in there:
            raise registry.unknown("dataset in this work dir", name, there)
    splits = {}
    for name in datasets or there:
        samples = work.table(name, "samples")
        splits[name] = {samples.receipt(n)["split"] for n in samples.parts()}
    chosen = [name for name, has in splits.items() if split in has]
    if missing := sorted(set(datasets) - set(chosen)):
        found = ", ".join(sorted(splits[missing[0]]))
        raise RsaDataError(f"{missing[0]}: expected the split {split!r}; found {found}")
    if not chosen:
        raise RsaDataError(
            f"{work.store.location}: no dataset there has the split {split!r}: index one with "
            "`rsa-data captions --dataset NAME`"
        )
    return chosen


def tables_of(work: Work, about: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """The tables of each dataset that the head described by `about` can be evaluated with.

    Raises RsaDataError when they are missing, or made otherwise than those it was trained on.
    """
    from ..heads import belong

    features, model = about["features"], about["depth_model"]
    sources = belong.sources(work, names, features["style"], features["encoder"], model["model"])
    for source in sources:
        embeddings = work.table(source.dataset, source.embeddings)
        depth = work.table(source.dataset, source.depth)
        trained = {k: v for k, v in features.items() if k != "dim"}
        belong.same(
            "head and embeddings",
            {"the head": trained, str(embeddings): belong.features_identity(embeddings)},
        )
        found, geometry = belong.depth_identity(depth)
        wanted = {k: v for k, v in model.items() if k != "geometry"}
        belong.same("head and depth", {"the head": wanted, str(depth): found})
        if (trained_at := model["geometry"].get(source.dataset)) is not None:
            belong.same("head and depth", {"the head": trained_at, str(depth): geometry})
    return {source.dataset: source for source in sources}


def rules_of(work: Work, name: str, protocol: str) -> Rules:
    """The protocol's rules for a dataset of the work dir."""
    kind = work.table(name, "samples").description()["options"]["dataset"]
    return rules(protocol, index.load_dataset(work, name), kind)


def parts_of(work: Work, name: str, depth: str, split: str) -> list[TestPart]:
    """The parts of a split, in order. Raises RsaDataError where depth is not done for all."""
    samples, table = work.table(name, "samples"), work.table(name, depth)
    numbers = [n for n in samples.parts() if samples.receipt(n)["split"] == split]
    if missing := set(numbers) - set(table.parts()):
        raise RsaDataError(
            f"{table}: {len(missing)} of {len(numbers)} parts of the {split} split are not done. "
            f"Run `rsa-data depth --dataset {name} --split {split}`"
        )
    return [TestPart(work, name, n, depth) for n in numbers]


def notes(about: Mapping[str, Any], rows: Sequence[Row], protocol: str) -> list[str]:
    """What a reader of the numbers must know."""
    said = ["Mean over images; in brackets the 95% interval, whole scenes drawn with replacement."]
    trained = about.get("datasets", {})
    names = list(dict.fromkeys(row.dataset for row in rows))
    if zero := [name for name in names if name not in trained]:
        said.append(f"Zero-shot (the head was not trained on it): {', '.join(zero)}.")
    for name in names:
        own = [row for row in rows if row.dataset == name]
        if own[0].scenes == 1:
            said.append(f"{name}: one scene only, so nothing is said about others; no interval.")
        if "one block" in trained.get(name, {}).get("validation", ""):
            said.append(f"{name}: its best epoch was chosen on frames of the training scene.")
        if len({row.images for row in own}) > 1:
            said.append(f"{name}: methods differ in the number of images that they could do.")
    if any(row.failed for row in rows):
        said.append("Some images failed: status and error in metrics.parquet.")
    if protocol == "monodepth2":
        said.append("Every prediction is scaled by the ground truth's median before clipping.")
    return said
