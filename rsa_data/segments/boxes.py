"""Decoders of dense detectors: a score and a box at every cell of some grids, then suppression."""

from functools import cache
from typing import Any

import numpy as np

from ..common.class_names import ClassTable
from ..common.errors import RsaDataError
from .decoding import Decoder, Outputs, sigmoid, softmax
from .found import Found
from .preprocess import Geometry

# Candidates that suppression looks at, the best ones: its cost is quadratic.
_CANDIDATES = 1000

# exp of it, times the smallest stride, is wider than any input.
_LARGEST_LOG = 20.0


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


@cache
def grid(height: int, width: int, strides: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Column, row (float32 (n, 2)) and stride (float32 (n, 1)) of the cells of all strides.

    height, width : px, of the input; strides in the order of the model's output, rows outermost.
    The arrays are shared: nobody may write to them.
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
    strides = tuple(settings.get("strides", (8, 16, 32)))
    threshold = settings["score_threshold"]

    def decode(outputs: Outputs, geometry: Geometry) -> Found:
        rows = outputs["predictions"][0]  # (n, 5 + classes)
        cells, stride = grid(geometry.input_height, geometry.input_width, strides)
        _check_raw(rows, len(cells))
        number = rows[:, 5:].argmax(1)  # (n,)
        score = rows[:, 4] * rows[np.arange(len(rows)), 5 + number]  # (n,)
        kept = np.flatnonzero(score > threshold)
        center = (rows[kept, :2] + cells[kept]) * stride[kept]
        size = np.exp(rows[kept, 2:4]) * stride[kept]
        box = np.concatenate([center - size / 2, center + size / 2], 1)
        found = box, score[kept], number[kept], kept
        return _suppressed(*found, len(rows), settings["overlap_threshold"], geometry)

    return Decoder(decode, {"predictions": (3, 2, 5 + table.count)})


def _check_raw(rows: np.ndarray, cells: int) -> None:
    """Raises RsaDataError for YOLOX's rows with decoded boxes, which have the shape of raw ones."""
    largest = float(np.abs(rows[:, 2:4]).max(initial=0))
    if len(rows) == cells and largest <= _LARGEST_LOG:
        return
    found = f"{len(rows)} rows" if len(rows) != cells else f"up to {largest:.0f}"
    raise RsaDataError(
        f"yolox: expected {cells} rows with logarithms of widths and heights; found {found}. Was "
        "the file exported with its decoding inside (decode_in_inference)? Use --segments onnx, or "
        "the family yolo with objectness = true in its card"
    )


def fastestdet(settings: dict[str, Any], table: ClassTable) -> Decoder:
    """FastestDet: `predictions` (1, 5 + classes, h, w) = objectness, dx, dy, w, h, classes.

    centre = (cell + tanh(dxy)) / grid, size = sigmoid(wh), both as shares of the input,
    score = objectness^0.6 * class^0.4 (dog-qiuqiu/FastestDet, example/onnx-runtime).
    """
    threshold = settings["score_threshold"]

    def decode(outputs: Outputs, geometry: Geometry) -> Found:
        maps = outputs["predictions"][0]  # (5 + classes, h, w)
        height, width = maps.shape[1:]
        rows = maps.reshape(len(maps), -1).T  # (h * w, 5 + classes)
        number = rows[:, 5:].argmax(1)  # (h * w,)
        best = rows[np.arange(len(rows)), 5 + number]
        score = np.maximum(rows[:, 0], 0) ** 0.6 * np.maximum(best, 0) ** 0.4
        kept = np.flatnonzero(score > threshold)
        cells = np.stack([kept % width, kept // width], 1)  # (n, 2)
        center = (cells + np.tanh(rows[kept, 1:3])) / [width, height]
        size = sigmoid(rows[kept, 3:5])
        box = np.concatenate([center - size / 2, center + size / 2], 1)
        box *= np.tile([geometry.input_width, geometry.input_height], 2)
        found = box, score[kept], number[kept], kept
        return _suppressed(*found, len(rows), settings["overlap_threshold"], geometry)

    return Decoder(decode, {"predictions": (4, 1, 5 + table.count)})


def nanodet(settings: dict[str, Any], table: ClassTable) -> Decoder:
    """NanoDet: for each stride s, `classes_s` (1, n, classes), `boxes_s` (1, n, 4 * bins).

    The distances left, top, right, bottom are the means of softmax over the bins, times s; the
    centre of a cell is cell * s + (s - 1) / 2 (RangiLyu/nanodet, NanoDetHead).
    """
    strides = tuple(settings.get("strides", (8, 16, 32)))
    threshold = settings["score_threshold"]

    def decode(outputs: Outputs, geometry: Geometry) -> Found:
        scores = np.concatenate([outputs[f"classes_{s}"][0] for s in strides])  # (n, classes)
        bins = np.concatenate([outputs[f"boxes_{s}"][0] for s in strides])  # (n, 4 * bins)
        cells, stride = grid(geometry.input_height, geometry.input_width, strides)
        if not len(scores) == len(bins) == len(cells):
            raise RsaDataError(
                f"nanodet: expected {len(cells)} cells for strides {list(strides)}; found "
                f"{len(scores)} classes and {len(bins)} boxes"
            )
        number = scores.argmax(1)  # (n,)
        score = scores.max(1)
        kept = np.flatnonzero(score > threshold)
        shares = softmax(bins[kept].reshape(len(kept), 4, bins.shape[1] // 4))  # (k, 4, bins)
        sides = shares @ np.arange(shares.shape[2]) * stride[kept]  # (k, 4)
        center = cells[kept] * stride[kept] + (stride[kept] - 1) / 2
        box = np.concatenate([center - sides[:, :2], center + sides[:, 2:]], 1)
        found = box, score[kept], number[kept], kept
        return _suppressed(*found, len(scores), settings["overlap_threshold"], geometry)

    roles = {f"classes_{s}": (3, 2, table.count) for s in strides}
    return Decoder(decode, roles | {f"boxes_{s}": (3, 0, 1) for s in strides})


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
