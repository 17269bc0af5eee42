"""Segmenters: ONNX models with their decoders, and importers of segments that exist already."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from ..common.errors import RowError
from ..store import schemas
from . import masks


@dataclass(frozen=True)
class Segments:
    """What one image shows.

    label : n class names.
    area : float64 of shape (n,), share of the full image, 0 to 1.
    score : float32 of shape (n,), 0 to 1; all 1 for annotations.
    is_thing : bool of shape (n,).
    box : float32 of shape (n, 4), px, x1 y1 x2 y2 clipped to the image, or None.
    width, height : px, of the full image, or None when the source has text only.
    center : float32 of shape (n, 2), px, x y: centre of mass of each mask; left None, it is the
        centre of the box.
    mask : n strings, COCO's compressed RLE counts of masks of the image's size, or None.
    feature : float32 of shape (n, d), the detector's features, or None.
    cell : int8 of shape (n,), cell of a 3 x 3 grid, 0 to 8 row by row, with most of each mask's
        pixels; left None, it is that of the box.
    """

    label: Sequence[str]
    area: np.ndarray
    score: np.ndarray
    is_thing: np.ndarray
    box: np.ndarray | None
    width: int | None
    height: int | None
    center: np.ndarray | None = None
    mask: Sequence[str] | None = None
    feature: np.ndarray | None = None
    cell: np.ndarray | None = None


def to_table(sample_ids: Sequence[str], found: Iterable[Segments | RowError]) -> pa.Table:
    """A segments table from one result a sample: segments, or the error that quarantines it."""
    results = list(found)
    good = [r if isinstance(r, Segments) else None for r in results]
    boxes = [None if g is None or g.box is None else np.asarray(g.box, np.float32) for g in good]
    centers = [
        (b[:, :2] + b[:, 2:]) / 2 if b is not None and g and g.center is None else g and g.center
        for b, g in zip(boxes, good, strict=True)
    ]
    rows = {
        "sample_id": sample_ids,
        "status": ["ok" if g else "failed" for g in good],
        "error": [None if g else str(r) for g, r in zip(good, results, strict=True)],
        "width": [g.width if g else None for g in good],
        "height": [g.height if g else None for g in good],
        "label": [list(g.label) if g else [] for g in good],
        "score": [g.score if g else [] for g in good],
        "area": [g.area if g else [] for g in good],
        "box": [None if b is None else list(b) for b in boxes],
        "is_thing": [g.is_thing if g else [] for g in good],
        "center": [None if c is None else list(np.asarray(c, np.float32)) for c in centers],
        "cell": [_cells(g) for g in good],
        "mask": [None if g is None or g.mask is None else list(g.mask) for g in good],
        "feature": [
            None
            if g is None or g.feature is None
            else [f.astype("<f4").tobytes() for f in g.feature]
            for g in good
        ],
    }
    return schemas.from_columns("segments", rows)


def _cells(found: Segments | None) -> list[int] | None:
    """The cell of each segment, where its source tells where it lies."""
    if found is None or (found.cell is None and found.box is None):
        return None
    if found.cell is not None:
        cells: list[int] = found.cell.tolist()
        return cells
    assert found.box is not None and found.width is not None and found.height is not None
    of_boxes: list[int] = masks.cells_of_boxes(found.box, found.width, found.height).tolist()
    return of_boxes


def from_row(row: dict[str, Any]) -> Segments | RowError:
    """The segments of one row of a segments table, or the error that quarantined it."""
    if row["status"] != "ok":
        return RowError(row["error"])
    count = len(row["label"])
    feature = row.get("feature")
    return Segments(
        label=row["label"],
        area=np.array(row["area"], np.float64),
        score=np.array(row["score"], np.float32),
        is_thing=np.array(row["is_thing"], bool),
        box=None if row["box"] is None else np.array(row["box"], np.float32).reshape(count, 4),
        width=row["width"],
        height=row["height"],
        center=None if row["center"] is None else np.array(row["center"], np.float32),
        mask=row["mask"],
        feature=feature and np.array([np.frombuffer(f, "<f4") for f in feature]),
        cell=None if row.get("cell") is None else np.array(row["cell"], np.int8),
    )
