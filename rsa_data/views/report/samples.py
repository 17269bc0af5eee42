"""Which samples a gallery shows, and everything the tables know of each."""

import difflib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ...common.errors import RsaDataError, UsageError
from ...datasets import index
from ...evaluation.inputs import TestPart
from ...heads.checkpoint import ScaleHead
from ...heads.metric import to_metric
from ...segments.segments import Segments
from ...store.table_names import head_folder
from ...store.tables import WorkDir
from .lineage import head_description, head_names, left_out
from .words import spread

# Depth of test splits is stored as whole maps, so few parts are opened.
_PARTS, _FAILED = 3, 6


@dataclass
class Sample:
    """One image with what every stage has made of it; what is missing is None or empty.

    where : folder of the dataset's files, or None. failures : `table: reason`.
    relative, truth, predicted : float32 (h, w), y and m, only where whole maps are stored.
    points : float32 (k, 2), y and m, of pixels that were drawn, where these are stored instead.
    fit : the image's own scale and shift.
    """

    row: dict[str, Any]
    where: Path | None
    segments: Segments | None = None
    captions: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    relative: np.ndarray | None = None
    truth: np.ndarray | None = None
    predicted: np.ndarray | None = None
    points: np.ndarray | None = None
    fit: tuple[float, float] | None = None
    scale: float | None = None
    shift: float | None = None
    head: str | None = None


def choose(work: WorkDir, dataset: str, count: int, wanted: str | None) -> list[Sample]:
    """About `count` samples of a dataset, half of them with whole depth maps, failed ones first.

    wanted : the head that predicts; by default one that was trained on this dataset, or any.
    """
    table = work.table(dataset, "samples")
    splits: dict[str, list[int]] = {}
    for number in table.parts():
        splits.setdefault(table.receipt(number).split, []).append(number)
    found: list[Sample] = []
    for numbers in splits.values():
        chosen = spread(numbers, _PARTS)
        bad = _with_failures(work, dataset, numbers)
        chosen = sorted({*chosen, *bad[:1]})
        for number in chosen:
            most = -(-count // (len(splits) * len(chosen)))
            rows = table.read(number, ["sample_id"])["sample_id"].to_pylist()
            names = [n for n in work.tables(dataset) if number in work.table(dataset, n).parts()]
            bad_ids = _failures(work, dataset, number, names)
            failed = [k for k, sample_id in enumerate(rows) if sample_id in bad_ids][:_FAILED]
            others = spread(list(range(len(rows))), max(most - len(failed), 1))
            found += _of_part(work, dataset, number, sorted({*failed, *others}), wanted)
    return found


def one(work: WorkDir, sample_id: str, wanted: str | None = None) -> Sample:
    """Everything the tables know of one sample; `wanted` as in `choose`.

    Raises UsageError, with the nearest, when no dataset of the work dir has it.
    """
    ids: list[str] = []
    for dataset in work.datasets():
        table = work.table(dataset, "samples")
        for number in table.parts() if sample_id.startswith(dataset + "/") else ():
            part = table.read(number, ["sample_id"])["sample_id"].to_pylist()
            if sample_id in part:
                return _of_part(work, dataset, number, [part.index(sample_id)], wanted)[0]
            ids += part
        ids += [] if ids else table.read(0, ["sample_id"])["sample_id"].to_pylist()[:1]
    near = difflib.get_close_matches(sample_id, ids, 1, 0.3) or ids[:1]
    raise UsageError(
        f"{work.store.location}: no sample {sample_id!r} there"
        + (f". Did you mean {near[0]!r}?" if near else ": no dataset is indexed")
    )


def _with_failures(work: WorkDir, dataset: str, numbers: list[int]) -> list[int]:
    tables = [work.table(dataset, name) for name in work.tables(dataset)]
    done = [(t, set(t.parts())) for t in tables]
    return [n for n in numbers if any(n in d and t.receipt(n).failed for t, d in done)]


class _Head(NamedTuple):
    name: str
    head: ScaleHead
    embeddings: str
    captions: str | None


@dataclass(frozen=True)
class _Part:
    """A part of a dataset and the samples of it that are shown, by row and by sample_id."""

    work: WorkDir
    dataset: str
    number: int
    chosen: list[int]
    ids: pa.Array

    def rows(self, name: str) -> list[dict[str, Any]]:
        """The rows of a table that belong to the samples shown."""
        rows = self.work.table(self.dataset, name).read(self.number)
        found: list[dict[str, Any]] = rows.filter(
            pc.is_in(rows["sample_id"], value_set=self.ids)
        ).to_pylist()
        return found

    def predict(self, found: _Head, samples: list[Sample]) -> None:
        """Sets scale, shift and head of the samples that the head has a feature of."""
        part = TestPart(self.work, self.dataset, self.number, "")
        try:
            features, there = part.features(found.embeddings, found.captions)
        except RsaDataError:
            return  # the captions were made again since; status says so
        if features.shape[1] != found.head.dim or not there[self.chosen].any():
            return
        scale, shift = found.head(features[self.chosen])
        for k, s in enumerate(samples):
            if there[self.chosen[k]]:
                s.scale, s.shift, s.head = float(scale[k]), float(shift[k]), found.name


def _of_part(
    work: WorkDir, dataset: str, number: int, chosen: list[int], wanted: str | None
) -> list[Sample]:
    """The samples in the rows `chosen` of a part."""
    rows = work.table(dataset, "samples").read(number).to_pylist()
    where = index.find_root(work, dataset)
    names = [n for n in work.tables(dataset) if number in work.table(dataset, n).parts()]
    failures = _failures(work, dataset, number, names)
    samples = [Sample(rows[k], where) for k in chosen]
    for s in samples:
        s.failures = failures.get(s.row["sample_id"], [])
    part = _Part(work, dataset, number, chosen, pa.array([s.row["sample_id"] for s in samples]))
    for name in names:
        if name.startswith("segments/"):
            _add_segments(part.rows(name), samples)
        elif name.startswith("captions/"):
            _add_captions(name.removeprefix("captions/"), part.rows(name), samples)
    found = _head_for(work, dataset, names, wanted)
    if found is not None:
        part.predict(found, samples)
    depth = [n for n in names if n.startswith("depth/")]
    if found is not None and (own := f"depth/{found.head.description['depth_model']['model']}"):
        depth = [n for n in depth if n == own] or depth
    if depth:
        _add_depth(part.rows(depth[0]), samples)
    return samples


def _failures(work: WorkDir, dataset: str, number: int, names: list[str]) -> dict[str, list[str]]:
    """What failed in a part, `table: reason` by sample_id."""
    found: dict[str, list[str]] = {}
    for name in names:
        table = work.table(dataset, name)
        if name.startswith(("segments/", "depth/")) and table.receipt(number).failed:
            rows = table.read(number, ["sample_id", "status", "error"])
            for row in rows.filter(pc.equal(rows["status"], "failed")).to_pylist():
                found.setdefault(row["sample_id"], []).append(f"{name}: {row['error']}")
    return found


def _add_segments(found: list[dict[str, Any]], samples: list[Sample]) -> None:
    rows = {row["sample_id"]: row for row in found}
    for s in samples:
        row = rows.get(s.row["sample_id"])
        if row and row["status"] == "ok" and s.segments is None:
            lists = {k: row[k] for k in ("label", "mask", "width", "height")}
            for key in ("score", "area", "is_thing"):
                lists[key] = np.array(row[key])
            box = None if row["box"] is None else np.array(row["box"]).reshape(-1, 4)
            s.segments = Segments(**lists, box=box)


def _add_captions(style: str, found: list[dict[str, Any]], samples: list[Sample]) -> None:
    told: dict[str, list[str]] = {}
    for row in found:
        told.setdefault(row["sample_id"], []).append(row["text"])
    for s in samples:
        s.captions += [f"{style}: {text}" for text in told.get(s.row["sample_id"], [])[:2]]


def _head_for(work: WorkDir, dataset: str, names: list[str], wanted: str | None) -> _Head | None:
    """A head, its embeddings and its captions for a part whose tables are `names`."""
    ranked = []
    for name in [wanted] if wanted else head_names(work):
        about = head_description(work, name)
        style, encoder = (about.get("features", {}).get(k) for k in ("style", "encoder"))
        embeddings, captions = f"embeddings/{style}/{encoder}", f"captions/{style}"
        # A head that reads objects has no single feature an image to show here.
        if (
            style != "objects"
            and embeddings in names
            and about.get("options", {}).get("control", "none") == "none"
        ):
            text = captions if captions in names else None
            ranked.append((dataset not in about.get("datasets", {}), name, embeddings, text))
    for _, name, embeddings, text in sorted(ranked, key=lambda r: r[:2]):
        try:
            head = ScaleHead.load(f"{work.store.location}/{head_folder(name)}")
        except RsaDataError as error:
            if wanted:
                raise
            left_out(name, error)
            continue
        return _Head(name, head, embeddings, text)
    return None


def _add_depth(found: list[dict[str, Any]], samples: list[Sample]) -> None:
    rows = {row["sample_id"]: row for row in found}
    for s in samples:
        row = rows.get(s.row["sample_id"])
        if not row or row["status"] != "ok":
            continue
        if row["fit_scale"] is not None and row["fit_shift"] is not None:
            s.fit = row["fit_scale"], row["fit_shift"]
        if row["kind"] != "map":
            drawn = [np.frombuffer(row[name], "<f2") for name in ("relative", "metric")]
            s.points = np.stack(drawn, 1).astype(np.float32)
            continue
        shape = row["height"], row["width"]
        y = s.relative = np.frombuffer(row["relative"], "<f2").reshape(shape).astype(np.float32)
        s.truth = np.frombuffer(row["metric"], "<f2").reshape(shape).astype(np.float32)
        if s.scale is not None:
            s.predicted = to_metric(y, s.scale, s.shift)
