"""`evaluate`: a head on the test splits, beside what bounds it and what it must beat."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pandas as pd
import pyarrow as pa

from ..common.errors import UsageError
from ..datasets import labels
from ..heads.belong import Tables
from ..store.table_names import head_folder
from ..store.tables import WorkDir
from . import output, protocols
from .breakdown import by_description
from .constants import fit_constants
from .external import external_methods
from .inputs import TestPart
from .methods import Method, by_constant, head_method, label_of, oracle_methods
from .options import Measuring
from .paper import paper_rows
from .regions import region_methods
from .rows import measure
from .setting import parts_of, rules_of, split_of, tables_of, with_split
from .sizes import by_object_sizes, has_sizes
from .summary import Row, few_scenes, no_better, summarise

if TYPE_CHECKING:
    from ..heads.description import Description


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
    work: WorkDir,
    bar: Callable[[str, int], Any] | None = None,
    *,
    head: str = "head",
    datasets: tuple[str, ...] = (),
    beside: tuple[str, ...] = (),
    external: tuple[str, ...] = (),
    style: str | None = None,
    depth_model: str | None = None,
    compare: str | None = None,
    measuring: Measuring = Measuring(),
) -> Evaluation:
    """Measures a head on whole maps of the test splits, beside oracles and constants.

    Parameters
    ----------
    head : name of a head in the work dir.
    datasets : datasets of the work dir; none means all that have the split. One that the head was
        not trained on is measured too and marked zero-shot.
    beside : further heads of the work dir to measure in the same table, such as controls.
    external : NAME=DIR, metric depth of another model as DIR/IMAGE.npy in m or 16-bit PNG in mm,
        or below DIR/DATASET where there are several.
    style : caption style, where the head does not say (an imported one) and there are several.
    depth_model : relative-depth model, as style.
    compare : paper adds the paper's rows where the conditions are the same, and says why not.

    Writes the metrics of each image (Parquet), the summary (Markdown, LaTeX, CSV) and the errors by
    number of objects, share covered and class (CSV) to WORK/heads/NAME/evaluation/PROTOCOL; with
    --datasets or another --split these stand in the folder's name.
    Raises RsaDataError when tables are missing or do not belong to the head, UsageError for
    unknown names.
    """
    from ..heads.checkpoint import ScaleHead

    if compare not in (None, "paper"):
        raise UsageError(f"--compare: expected paper, found {compare!r}")
    protocol, split = measuring.protocol, measuring.split
    folders = {name: head_folder(name) for name in (head, *beside)}
    now = output.heads_now(work, folders)
    heads = {
        name: ScaleHead.load(f"{work.store.location}/{place}") for name, place in folders.items()
    }
    about = heads[head].about
    names = with_split(work, datasets, split)
    wanted = Tables(datasets=tuple(names), style=style, depth_model=depth_model)
    tables = {name: tables_of(work, other.about, wanted) for name, other in heads.items()}
    ranges = {name: rules_of(work, name, protocol, measuring.beyond) for name in names}
    depths = {name: source.depth for name, source in tables[head].items()}
    limits = {name: (rule.min_depth, rule.max_depth) for name, rule in ranges.items()}
    constants = fit_constants(work, depths, limits, about.trained_on)
    found, theirs, said, by = [], [], [], []
    for name in names:
        methods: dict[str, Method] = {
            "head" if label == head else label_of(label, other): head_method(
                other, tables[label][name]
            )
            for label, other in heads.items()
        }
        parts = parts_of(work, name, depths[name], split)
        captions = tables[head][name].captions
        if segments := has_sizes(work, tables[head][name], parts[0]):
            methods["object sizes"] = by_object_sizes(segments)
        methods |= {
            **external_methods(external, name),
            **{label: by_constant(*pair) for label, pair in constants[name].items()},
            **oracle_methods(ranges[name].max_depth),
            **region_methods(work, tables[head][name], parts[0]),
        }
        found.append(measure(parts, methods, ranges[name], bar))
        if compare:
            rows, notes_ = _paper(work, name, depths[name], parts, measuring)
            theirs += rows
            said += notes_
        if captions:
            numbers = [p.number for p in parts]
            by.append(by_description(work, name, captions, numbers, found[-1].to_pandas()))
    table = pa.concat_tables(found)
    rows = summarise(table, measuring.draws, synthetic=labels.synthetic_of(work, names))
    said = notes(about, rows, measuring) + said
    shown = [row for name in names for row in (*rows, *theirs) if row.dataset == name]
    folder = f"heads/{head}/evaluation/{output.folder_name(measuring, datasets)}"
    summary = output.Summary(f"head {head}: protocol {protocol}, {split} split", shown, said)
    files = {"metrics.parquet": output.to_parquet(table), **summary.files()}
    if by:
        content = pd.concat(by).to_csv(index=False, lineterminator="\n")
        files["by_description.csv"] = content.encode()
    output.write(work, folder, files, output.record_of(now, names, measuring))
    text = f"{files['summary.txt'].decode()}\nin {work.store.location}/{folder}"
    return Evaluation(table, rows, text, folder)


def _paper(
    work: WorkDir, name: str, depth: str, parts: Sequence[TestPart], measuring: Measuring
) -> tuple[list[Row], list[str]]:
    """The paper's rows that hold under the same conditions, and why others do not stand here."""
    table = work.table(name, depth)
    return paper_rows(
        name,
        work.table(name, "samples").description().options["dataset"],
        split=split_of(measuring.split, name),
        protocol=measuring.protocol,
        images=sum(table.receipt(part.number).ok for part in parts),
        model=table.name.partition("/")[2],
        options=table.description().options,
    )


def notes(about: "Description", rows: Sequence[Row], measuring: Measuring) -> list[str]:
    """What a reader of the numbers must know."""
    said = ["Mean over images; in brackets the 95% interval, whole scenes drawn with replacement."]
    trained = about.trained_on
    names = list(dict.fromkeys(row.dataset for row in rows))
    if about.imported:
        said.append(
            "The head was imported: its file does not say which captions and depth model it was "
            "trained for; it is right only with those of its authors."
        )
    elif zero := [name for name in names if name not in trained]:
        said.append(f"Zero-shot (the head was not trained on it): {', '.join(zero)}.")
    for name in names:
        own = [row for row in rows if row.dataset == name]
        said += few_scenes(name, own[0].scenes, own[0].images)
        if name in trained and "one block" in trained[name].validation:
            said.append(f"{name}: its best epoch was chosen on frames of the training scene.")
        errors = {row.method: row.mean["abs_rel"] for row in own if row.mean}
        if not own[0].mean:
            said.append(f"{name}: nothing could be measured: see error in metrics.parquet.")
        elif sentence := no_better(name, errors, own[0].method):
            said.append(sentence)
        failed = {row.method: row.failed for row in own if row.failed}
        if failed and len(set(failed.values())) == 1 and len(failed) == len(own):
            said.append(f"{name}: {own[0].failed} images failed: see error in metrics.parquet.")
        elif failed:
            some = ", ".join(f"{method} {count}" for method, count in failed.items())
            said.append(
                f"{name}: images that a method could not do, and that its mean leaves out: {some}; "
                "why: error in metrics.parquet."
            )
    said += labels.note({row.dataset for row in rows if row.synthetic})
    if protocols.protocol(measuring.protocol).median_scaled:
        said.append("Every prediction is scaled by the ground truth's median before clipping.")
    if measuring.beyond == "near":
        said.append(
            "Where scale * y + shift is negative the depth is the minimum, as the released code "
            "has it, not the maximum (--beyond near)."
        )
    return said
