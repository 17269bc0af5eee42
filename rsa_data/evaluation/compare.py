"""The comparison that settles what a head learns from: every input under one protocol."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import pandas as pd
import pyarrow as pa

from ..common.ranges import AtOnce, Positive
from ..datasets import labels
from ..heads.belong import Tables
from ..store.table_names import comparison_folder
from ..store.tables import WorkDir
from . import breakdown, formats, output, paired, plots
from .constants import fit_constants
from .contenders import Entry, inputs_of, methods_of, plans, train, training_images
from .evaluate import Evaluation, notes
from .known_metrics import metrics
from .methods import by_constant, oracle_methods
from .options import Measuring
from .protocols import Rules
from .regions import region_methods
from .rows import measure
from .setting import parts_of, rules_of, with_split
from .spread import calibration, inflation, rank_correlation, spread
from .summary import summarise

# Training images up to which every head is trained with several seeds.
_FEW = 5000


@dataclass(frozen=True)
class Contest:
    """Which heads are compared.

    inputs : further inputs as LABEL=STYLE/ENCODER or LABEL=STYLE/ENCODER/HEAD, of embeddings
        tables that every dataset has, such as counts=counts/clip-rn50.
    subsets : further sets of datasets to train text on, such as nyuv2+kitti beside all three.
    zero_shot : datasets to measure on and never train on; those without a training split always
        are.
    seeds : heads trained for each input; their errors are averaged, their spread is reported. By
        default 3 up to 5,000 training images, where a training takes seconds, and 1 beyond.
    """

    inputs: tuple[str, ...] = ()
    subsets: tuple[str, ...] = ()
    zero_shot: tuple[str, ...] = ()
    seeds: Positive | None = None


@dataclass(frozen=True)
class Recipe:
    """How each head of a comparison is trained.

    loss : of each training, one of `rsa-data list losses`.
    epochs : of each training.
    threads : CPU threads of each training.
    split_scene : as for train-head, for datasets of one scene.
    start_over : train all heads again.
    """

    loss: str = "l1"
    epochs: Positive = 50
    threads: AtOnce = 2
    split_scene: bool = False
    start_over: bool = False


def compare(
    work: WorkDir,
    bar: Callable[[str, int], Any] | None = None,
    *,
    name: str = "comparison",
    tables: Tables = Tables(),
    contest: Contest = Contest(),
    recipe: Recipe = Recipe(),
    measuring: Measuring = Measuring(),
) -> Evaluation:
    """Trains heads on each kind of input and measures them all on the same images.

    Text, images by each encoder that embedded them (`rsa-data embed-images`), both together,
    further inputs asked for, the dataset's name only, captions shuffled within the dataset,
    constants and oracles; text trained on each dataset alone, which gives the zero-shot rows; one
    description for a whole scene; the hard images by themselves; the spread over caption variants
    as an error bar. Heads that are trained already are taken as they are.

    Parameters
    ----------
    name : of the comparison; its heads are named after it.

    Writes metrics, summaries and plots to WORK/comparisons/NAME.
    """
    protocol, split = measuring.protocol, measuring.split
    names = with_split(work, tables.datasets, split)
    learn = [d for d in names if d not in contest.zero_shot and training_images(work, [d])]
    shared = inputs_of(work, names, tables.style, tables.encoder)
    kinds = plans(learn, shared, contest.inputs, contest.subsets)
    common = {"depth_model": tables.depth_model, **asdict(recipe)}
    seeds = contest.seeds or (3 if training_images(work, learn) <= _FEW else 1)
    entries = [
        train(work, bar, name, plan, {**common, "seed": seed}, names)
        for seed in range(seeds)
        for plan in kinds
    ]
    now = output.heads_now(work, [entry.name for entry in entries])
    text = entries[0]
    ranges = {d: rules_of(work, d, protocol, measuring.beyond) for d in names}
    depths = {d: text.sources[d].depth for d in names}
    limits = {d: (rule.min_depth, rule.max_depth) for d, rule in ranges.items()}
    constants = fit_constants(work, depths, limits, learn)
    found = []
    for d in names:
        parts = parts_of(work, d, depths[d], split)
        methods = {
            **methods_of(entries, d, parts),
            **{label: by_constant(*pair) for label, pair in constants[d].items()},
            **oracle_methods(ranges[d].max_depth),
            **region_methods(work, text.sources[d], parts[0]),
        }
        found.append(measure(parts, methods, ranges[d], bar))
    table = pa.concat_tables(found)
    merged, over_seeds = merge_seeds(table)
    rows = summarise(merged, measuring.draws, synthetic=labels.synthetic_of(work, names))
    said = [
        f"Comparison {name}: protocol {protocol}, {split} split, {seeds} seeds, "
        f"{recipe.epochs} epochs; mean over images [95% interval by scene].",
        *over_seeds,
        *notes(text.head.about, rows, measuring)[1:],
    ]
    extra = _hard(work, text, names, merged, split)
    apart = paired.differences(merged.to_pandas(), "text", measuring.draws)
    if apart:
        told = "AbsRel of each row less that of text, on the same images [95% interval by scene]:"
        extra = ["\n".join([told, *(row.line for row in apart)]), *extra]
    bars, lines = _error_bars(work, text, names, ranges, split)
    folder = comparison_folder(name)
    texts = {
        "summary.txt": "\n\n".join(["\n".join([*said, formats.text(rows)]), *extra, *lines]),
        "summary.md": "\n\n".join([*said, formats.markdown(rows), *extra, *lines]) + "\n",
        "summary.tex": formats.latex(rows),
        "summary.csv": formats.to_csv(rows),
        "paired.csv": paired.to_csv(apart),
        "abs_rel.svg": plots.intervals(rows, "abs_rel", "AbsRel, with 95% intervals by scene"),
    }
    if bars:
        texts["calibration.svg"] = plots.calibration(bars, "Spread over captions as an error bar")
    files = {"metrics.parquet": output.to_parquet(table)}
    files |= {file: content.encode() for file, content in texts.items()}
    output.write(work, folder, files, output.record_of(now, names, measuring))
    summary = texts["summary.txt"] + f"\nin {work.store.location}/{folder}"
    return Evaluation(table, rows, summary, folder)


def merge_seeds(table: pa.Table) -> tuple[pa.Table, list[str]]:
    """Rows `METHOD #SEED` averaged over seeds, and how far the means of the seeds lie apart."""
    frame = table.to_pandas()
    frame["seed"] = frame["method"].str.extract(r" #(\d+)$")[0]
    frame["method"] = frame["method"].str.replace(r" #\d+$", "", regex=True)
    keys = ["sample_id", "dataset", "scene", "method", "status"]
    merged = frame.groupby(keys, sort=False, dropna=False)[list(metrics())].mean().reset_index()
    lines = []
    if frame["seed"].nunique() > 1:
        means = frame.groupby(["dataset", "method", "seed"], sort=False)["abs_rel"].mean()
        for (dataset, method), spread_ in (
            means.groupby(["dataset", "method"], sort=False).std().items()
        ):
            lines.append(f"{dataset}: {method}: AbsRel over seeds +- {spread_:.4f}")
    return pa.Table.from_pandas(merged, preserve_index=False), lines


def _hard(
    work: WorkDir, text: Entry, names: Sequence[str], merged: pa.Table, split: str
) -> list[str]:
    """AbsRel of the hard images of each dataset, as text."""
    frame = merged.to_pandas()
    found = []
    for d in names:
        source = text.sources[d]
        if not source.captions:
            continue
        numbers = [part.number for part in parts_of(work, d, source.depth, split)]
        about = breakdown.described(work, d, source.captions, numbers)
        table = breakdown.by_group(frame[frame["dataset"] == d], about)
        found.append(f"{d}: AbsRel of hard images (number of them)\n{breakdown.text(table)}")
    return found


def _error_bars(
    work: WorkDir, text: Entry, names: Sequence[str], ranges: Mapping[str, Rules], split: str
) -> tuple[dict[str, list[dict[str, float]]], list[str]]:
    """Calibration of the spread over caption variants for each dataset, and sentences about it."""
    bars, lines = {}, []
    for d in names:
        source = text.sources[d]
        if not source.captions:
            continue
        parts = parts_of(work, d, source.depth, split)
        column = work.table(d, source.captions).read(parts[0].number, ["variant"])["variant"]
        variants = sorted(set(pd.Series(column.to_numpy())) - {0})
        if len(variants) < 2:
            continue
        found = spread(parts, text.head.outputs, source, ranges[d], variants)
        bars[d] = calibration(found)
        lines.append(
            f"{d}: spread over {len(variants)} caption variants as an error bar: to match the "
            f"errors it must be multiplied by {inflation(found):.1f}; rank correlation with the "
            f"error {rank_correlation(found):+.2f}"
        )
    return bars, lines
