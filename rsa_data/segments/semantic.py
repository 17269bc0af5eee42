"""Decoder of semantic segmentation: a class for every pixel becomes segments of stuff."""

from typing import Any

import numpy as np

from ..common.class_names import ClassTable
from . import masks
from .decoding import Decoder, Outputs
from .found import Found
from .preprocess import Geometry


def semantic(settings: dict[str, Any], table: ClassTable) -> Decoder:
    """`map`: logits or probabilities (1, c, h, w), or (1, h, w, c) with layout NHWC.

    They are resized to the image, then the largest wins. A segment's score is the mean over its
    pixels of the highest probability there. Classes without a name (background) are no segments.

    layout : NCHW or NHWC.
    probabilities : whether the graph ends in a softmax.
    components : one segment for each connected region (8 neighbours) instead of each class;
        only then classes count as things.
    smallest : share of the image below which a segment is left out.
    """
    nhwc, ready = settings.get("layout") == "NHWC", settings.get("probabilities", False)
    split, smallest = settings.get("components", False), settings.get("smallest", 0.0)
    threshold = settings.get("score_threshold", 0.0)

    def decode(outputs: Outputs, geometry: Geometry) -> Found:
        values = outputs["map"][0]
        values = (values.transpose(2, 0, 1) if nhwc else values).astype(np.float32)  # (c, h, w)
        winner, share = _winners(values, geometry, ready)  # (height, width) each
        number, index = _regions(winner, table, split)
        count = np.bincount(index[index >= 0], minlength=len(number))
        sums = np.bincount(index[index >= 0], share[index >= 0], len(number))
        score = sums / np.maximum(count, 1)
        good = (count >= smallest * index.size) & (score >= threshold)
        index = np.append(np.where(good, np.cumsum(good) - 1, -1), -1)[index]  # -1 stays -1
        number, score = number[good], score[good]
        things = None if split else np.zeros(len(number), bool)
        return Found(number, score, index=index, is_thing=things)

    return Decoder(decode, {"map": (4, 3 if nhwc else 1, table.count)})


def _winners(
    values: np.ndarray, geometry: Geometry, probabilities: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Class of each pixel of the image, and the highest probability there, both (height, width).

    The probability is taken at the map's own size and resized, which costs one map, not all.
    """
    height, width = geometry.height, geometry.width
    best = np.full((height, width), -np.inf, np.float32)
    winner = np.zeros((height, width), np.int32)
    for k, value in enumerate(values):
        value = masks.resize(value, height, width, geometry.shown)
        wins = value > best
        np.copyto(best, value, where=wins)
        np.copyto(winner, k, where=wins)
    highest = values.max(0)
    if not probabilities:
        highest = 1 / np.exp(values - highest).sum(0)
    return winner, masks.resize(highest, height, width, geometry.shown)


def _regions(winner: np.ndarray, table: ClassTable, split: bool) -> tuple[np.ndarray, np.ndarray]:
    """Class of each segment (n,), and the segment of each pixel (height, width), -1: none."""
    import cv2

    index = np.full(winner.shape, -1, np.int32)
    numbers: list[int] = []
    for number in np.flatnonzero(np.bincount(winner.ravel())).tolist():
        if number not in table.names:
            continue
        there = winner == number
        if not split:
            index[there] = len(numbers)
            numbers.append(number)
            continue
        count, parts = cv2.connectedComponents(there.astype(np.uint8), connectivity=8)
        index[there] = parts[there] - 1 + len(numbers)
        numbers += [number] * (count - 1)
    return np.array(numbers, np.int64), index
