"""Decoders of dense detectors: a score and a box at every cell of some grids, then suppression."""

from typing import Any

import numpy as np

from .classes import ClassTable
from .decoding import Decoder, Outputs
from .found import Found
from .preprocess import Geometry

# Candidates that suppression looks at, the best ones: its cost is quadratic.
_CANDIDATES = 1000


def suppress(box: np.ndarray, score: np.ndarray, number: np.ndarray, overlap: float) -> np.ndarray:
    """Greedy non-maximum suppression within each class: rows kept, best score first.

    box : float (n, 4) x1 y1 x2 y2.  number : int (n,), classes; others never suppress each other.
    overlap : intersection over union above which the lower score goes; ties go to the earlier row.
    """
    order = np.argsort(-score, kind="stable")[:_CANDIDATES]
    box, number = box[order].astype(np.float64), number[order]
    low = np.maximum(box[:, None, :2], box[None, :, :2])
    high = np.minimum(box[:, None, 2:], box[None, :, 2:])
    inside = np.prod(np.maximum(high - low, 0), axis=2)  # (n, n)
    area = np.prod(np.maximum(box[:, 2:] - box[:, :2], 0), axis=1)  # (n,)
    union = area[:, None] + area[None] - inside
    clash = (inside > overlap * union) & (number[:, None] == number[None])  # (n, n)
    alive = np.ones(len(order), bool)
    for k in range(len(order)):
        if alive[k]:
            alive[k + 1 :] &= ~clash[k, k + 1 :]
    return order[alive]


def grid(height: int, width: int, strides: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Column, row (float32 (n, 2)) and stride (float32 (n, 1)) of the cells of all strides.

    height, width : px, of the input; strides in the order of the model's output, rows outermost.
    """
    cells, sizes = [], []
    for stride in strides:
        y, x = np.mgrid[: -(-height // stride), : -(-width // stride)]
        cells.append(np.stack([x.ravel(), y.ravel()], 1))
        sizes.append(np.full((x.size, 1), stride))
    return np.concatenate(cells).astype(np.float32), np.concatenate(sizes).astype(np.float32)


def yolox(settings: dict[str, Any], table: ClassTable) -> Decoder:
    """YOLOX: `predictions` (1, n, 5 + classes) = x, y, w, h, objectness, classes, per grid cell.

    centre = (xy + cell) * stride, size = exp(wh) * stride, score = objectness * class
    (Megvii-BaseDetection/YOLOX, demo_utils.demo_postprocess).
    """
    strides, threshold = settings.get("strides", [8, 16, 32]), settings["score_threshold"]

    def decode(outputs: Outputs, geometry: Geometry) -> Found:
        rows = outputs["predictions"][0]  # (n, 5 + classes)
        cells, stride = grid(geometry.input_height, geometry.input_width, strides)
        number = rows[:, 5:].argmax(1)  # (n,)
        score = rows[:, 4] * rows[np.arange(len(rows)), 5 + number]  # (n,)
        kept = np.flatnonzero(score > threshold)
        center = (rows[kept, :2] + cells[kept]) * stride[kept]
        size = np.exp(rows[kept, 2:4]) * stride[kept]
        box = np.concatenate([center - size / 2, center + size / 2], 1)
        found = box, score[kept], number[kept], kept
        return _suppressed(*found, len(rows), settings["overlap_threshold"], geometry)

    return Decoder(decode, {"predictions": (3, 2, 5 + table.count)})


def _suppressed(
    box: np.ndarray,
    score: np.ndarray,
    number: np.ndarray,
    query: np.ndarray,
    candidates: int,
    overlap: float,
    geometry: Geometry,
) -> Found:
    kept = suppress(box, score, number, overlap)
    box = geometry.to_image(box[kept])
    return Found(number[kept], score[kept], box, query=query[kept], candidates=candidates)
