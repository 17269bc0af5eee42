"""How heads were trained and how they did: curves, and evaluations beside the paper's numbers."""

import csv
import hashlib
import io
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq

from ... import registry
from ...common import html
from ...common.errors import RsaDataError
from ...common.html import Html, tag
from ...datasets import labels
from ...evaluation import output
from ...evaluation.known_metrics import metrics
from ...evaluation.options import Measuring
from ...evaluation.paper import paper_rows
from ...evaluation.setting import split_of
from ...evaluation.summary import no_better
from ...heads.predict.find import in_work
from ...store.tables import WorkDir
from . import plots
from .lineage import head_description, head_names, head_problem

if TYPE_CHECKING:
    from ...heads.train.losses import Loss


def _shown() -> dict[str, str]:
    """The metrics of narrow tables: name -> heading with its unit."""
    short = [metric for metric in metrics().values() if metric.short]
    return {m.name: f"{m.heading} ({m.unit})" if m.unit else m.heading for m in short}


def heads(work: WorkDir) -> Html:
    """A section: for each head its curves, and a table for each protocol it was measured under."""
    said = [tag("p", text) for name in in_work(work) if (text := head_problem(work, name))]
    found = [*said, *(_head(work, name) for name in head_names(work)), *_comparisons(work)]
    nothing = tag("p", "There is no head in this work dir yet.")
    return tag("section", tag("h2", "Heads"), found or nothing, id="heads")


def _head(work: WorkDir, name: str) -> Html:
    about = head_description(work, name)
    architecture = about.get("architecture", {}).get("name", "?")
    features = about.get("features", {})
    told = (
        f"{architecture}, {about.get('parameters', 0):,} parameters, on "
        f"{_read(features)} by {features.get('encoder')}; relative depth of "
        f"{about.get('depth_model', {}).get('model')}."
    )
    notes = [
        tag("li", f"{labels.shown(dataset, facts.get('synthetic', False))}: "
            f"{facts.get('images', 0):,} images for training, "
            f"{facts.get('validation_images', 0):,} for validation ({facts.get('validation')}).")
        for dataset, facts in about.get("datasets", {}).items()
    ]  # fmt: skip
    return tag(
        "article", tag("h3", f"Head {name}"), tag("p", told), tag("ul", notes) if notes else "",
        tag("div", _sound(lambda: _curves(work, name)), class_="plots"),
        _evaluations(work, name),
    )  # fmt: skip


def _read(features: dict[str, Any]) -> str:
    """What a head reads, in words."""
    styles = [one.get("style") for one in (features, *(features.get("beside") or []))]
    known = {"objects": "objects", "images": "the image", "proposals": "a detector's features"}
    return " and ".join(known.get(str(style), f"{style} captions") for style in styles)


def _curves(work: WorkDir, name: str) -> list[Html]:
    path = f"heads/{name}/history.parquet"
    if work.store.size(path) is None:
        return []
    if wanted := head_description(work, name).get("history"):
        _check(work, path, wanted)
    with work.store.open(path) as file:
        rows = pq.read_table(file).to_pylist()
    if not rows:
        return []
    loss = {row["epoch"]: row["train_loss"] for row in rows}
    errors: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        errors.setdefault(row["dataset"], []).append((row["epoch"], row["val_abs_rel"]))
    best = next((row["epoch"] for row in rows if row["best"]), None)
    kept = f"; the weights of epoch {best} were kept" if best else ""
    return [
        plots.lines(f"Head {name}: AbsRel on validation images{kept}", errors, "epoch",
                  "AbsRel (no unit)"),
        plots.lines(f"Head {name}: loss on training images",
                  {"all datasets": list(loss.items())}, "epoch", _loss_unit(work, name)),
    ]  # fmt: skip


def _loss_unit(work: WorkDir, name: str) -> str:
    options = head_description(work, name).get("options", {})
    name, of = options.get("loss", "loss"), options.get("supervision", "depth")
    # Of a fit, and of what enters as a logarithm, the error has no unit; a loss that is not
    # known here says nothing of its own.
    if (
        options.get("log_loss")
        or of != "depth"
        or name not in registry.LOSSES
        or not _loss(name).in_metres
    ):
        return f"{name} of {of}"
    unit = "m" if options.get("units") == "metres" else "share of mean depth"
    return f"{name} of {of} ({unit})"


def _loss(name: str) -> "Loss":
    found: Loss = registry.resolve("loss", registry.LOSSES, name)
    return found


def _evaluations(work: WorkDir, name: str) -> list[Html]:
    found = []
    kinds = {
        "evaluation": "on test images; 95% intervals in brackets",
        "robustness": "with descriptions that are wrong or poor",
    }
    for kind, what in kinds.items():
        for folder in work.store.list(f"heads/{name}/{kind}"):
            protocol = folder.rstrip("/")
            title = f"Head {name} {what}, protocol {protocol}"
            found += _sound(partial(_evaluation, work, name, kind, protocol, title))
    return found


def _evaluation(work: WorkDir, name: str, kind: str, protocol: str, title: str) -> list[Html]:
    rows = _rows(work, f"heads/{name}/{kind}/{protocol}")
    theirs, said = _paper(work, name, protocol, rows) if kind == "evaluation" else ([], [])
    return _measured(title, rows, theirs, [*_no_better(rows), *said])


def _sound(draw: Callable[[], list[Html]]) -> list[Html]:
    """What `draw` gives, or in its place what is wrong with the files that it reads."""
    try:
        return draw()
    except RsaDataError as error:
        told = str(error)
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError) as error:
        told = f"damaged: {error}"  # of version 0.1: files without a digest
    warnings.warn(f"not shown in the report: {told}", stacklevel=2)
    return [tag("p", f"Not shown: {told}")]


def _no_better(rows: list[dict[str, str]]) -> list[str]:
    """A sentence for each dataset on which the head, whose row is the first, beats no constant."""
    errors: dict[str, dict[str, float]] = {}
    for row in rows:
        if row.get("abs_rel"):
            errors.setdefault(row["dataset"], {})[row["method"]] = float(row["abs_rel"])
    found = [no_better(name, own, next(iter(own))) for name, own in errors.items()]
    return [sentence for sentence in found if sentence]


def _comparisons(work: WorkDir) -> list[Html]:
    """Tables of `rsa-data compare`: heads on other inputs, and controls."""
    names = [folder.rstrip("/") for folder in work.store.list("comparisons")]
    found = [part for name in names for part in _sound(partial(_comparison, work, name))]
    return [tag("h3", "Comparisons"), *found] if found else []


def _comparison(work: WorkDir, name: str) -> list[Html]:
    rows = _rows(work, f"comparisons/{name}")
    return _measured(f"Comparison {name}: inputs and controls", rows)


def _check(work: WorkDir, path: str, sha256: str) -> None:
    """Raises RsaDataError unless a file is the one that was written."""
    if hashlib.sha256(work.store.read(path) or b"").hexdigest() != sha256:
        raise RsaDataError(f"{work.store.location}/{path}: damaged: expected sha256 {sha256}")


def _rows(work: WorkDir, folder: str) -> list[dict[str, str]]:
    record = output.read_record(work, folder)
    if record is not None and (wanted := record.files.get("summary.csv")):
        _check(work, f"{folder}/summary.csv", wanted)
    data = work.store.read(f"{folder}/summary.csv")
    return [] if data is None else list(csv.DictReader(io.StringIO(data.decode())))


def _measured(
    title: str,
    rows: list[dict[str, str]],
    others: Sequence[list[Any]] = (),
    said: Sequence[str] = (),
) -> list[Html]:
    """A table of measures, datasets together; nothing where there are no rows."""
    if not rows:
        return []
    shown = [*map(_cells, rows), *others]
    order = list(dict.fromkeys(row[0] for row in shown))
    shown.sort(key=lambda row: order.index(row[0]))
    header = ["dataset", "method", "images", *_shown().values()]
    synthetic = {row["dataset"] for row in rows if row.get("synthetic") == "yes"}
    notes = [tag("p", line, class_="note") for line in (*labels.note(synthetic), *said)]
    return [tag("div", html.table(header, shown, title), notes)]


def _cells(row: dict[str, str]) -> list[str]:
    name = labels.shown(row["dataset"], row.get("synthetic") == "yes")
    cells = [name, row["method"], row["images"]]
    for metric in _shown():
        cell = f"{float(row[metric]):.3f}" if row.get(metric) else "-"
        if metric == "abs_rel" and row.get("abs_rel_low"):
            cell += f" [{float(row['abs_rel_low']):.3f}, {float(row['abs_rel_high']):.3f}]"
        cells.append(cell)
    return cells


def _paper(
    work: WorkDir, name: str, folder: str, rows: list[dict[str, str]]
) -> tuple[list[list[Any]], list[str]]:
    """The paper's rows that hold under the same conditions, and why others do not stand here."""
    if any(row["method"].startswith("paper:") for row in rows):
        return [], []
    found: list[list[Any]] = []
    said: list[str] = []
    try:
        record = output.read_record(work, f"heads/{name}/evaluation/{folder}")
    except RsaDataError as error:
        return [], [str(error)]
    how = Measuring() if record is None else Measuring(record.protocol, record.split)
    for dataset in dict.fromkeys(row["dataset"] for row in rows):
        model = head_description(work, name).get("depth_model", {}).get("model")
        try:
            options = work.table(dataset, f"depth/{model}").description().options
            kind = work.table(dataset, "samples").description().options["dataset"]
        except (RsaDataError, KeyError):
            continue
        theirs, notes = paper_rows(
            dataset, kind, split=split_of(how.split, dataset), protocol=how.protocol,
            model=str(model), options=options,
            images=max(int(row["images"]) for row in rows if row["dataset"] == dataset),
        )  # fmt: skip
        said += notes
        for row in theirs:
            cells = [f"{row.mean[m]:.3f}" if m in row.mean else "-" for m in _shown()]
            found.append([row.dataset, row.method, row.images, *cells])
    return found, said
