"""Decoder of models that answer with queries, each a class and a mask: panoptic segments."""

from collections.abc import Callable
from typing import Any

import numpy as np

from . import masks
from .classes import ClassTable
from .decoding import Decoder, Outputs
from .found import Found
from .preprocess import Geometry


def panoptic(settings: dict[str, Any], table: ClassTable) -> Decoder:
    """DETR panoptic, MaskFormer, Mask2Former, MaskDINO: `classes` (1, q, c), `masks` (1, q, h, w).

    Settings, with what transformers' post_process_panoptic_segmentation does and, where it
    differs, [what MaskDINO's panoptic inference does]:

    score : softmax, the last class being none [maskdino: sigmoid, sharpened, see `_scores`].
    score_threshold : queries at or below it are dropped.
    sigmoid : first, at the mask's own size [last, at the image's]; between: after `through`.
    through : [height, width] px that masks are resized to on the way, or "input" for the input's.
    own_threshold : a segment is the pixels where its score * mask is largest [and where the mask
        reaches this]; 0: the first.
    overlap_threshold : of the pixels where a query's mask reaches 0.5, the share that must be its
        own: more than that [or just that, `overlap_inclusive`].
    overlap_weighted : whether that 0.5 is of score * mask [or of the mask].
    merge_stuff : whether segments of one stuff class become one.
    """
    score_of, threshold = _scores(settings["score"]), settings["score_threshold"]
    own, overlap = settings.get("own_threshold", 0.0), settings["overlap_threshold"]
    inclusive = settings.get("overlap_inclusive", False)
    weighted = settings.get("overlap_weighted", True)
    merge = settings.get("merge_stuff", False)

    def decode(outputs: Outputs, geometry: Geometry) -> Found:
        score, number, kept = score_of(outputs["classes"][0].astype(np.float32), threshold)
        score, number, query = score[kept], number[kept], np.flatnonzero(kept)
        height, width = geometry.height, geometry.width
        best = np.zeros((height, width), np.float32)
        index = np.full((height, width), -1, np.int32)
        reach = np.zeros(len(query), np.int64)
        at_least = np.zeros((height, width), bool)  # where the mask of `index` reaches `own`
        # One mask at a time at the image's size: memory does not grow with the queries.
        for k, q in enumerate(query):
            mask = _resized(outputs["masks"][0, q], geometry, settings)  # (height, width)
            value = mask * score[k]
            reach[k] = np.count_nonzero((value if weighted else mask) >= 0.5)
            # argmax gives ties to the first, and pixels where all are 0 to query 0.
            wins = value > best if k else np.ones_like(at_least)
            best[wins], index[wins] = value[wins], k
            if own:
                at_least[wins] = mask[wins] >= own
        won = np.bincount(index[index >= 0].ravel(), minlength=len(query))
        if own:
            index[~at_least] = -1
        ratio = won / np.maximum(reach, 1)
        good = (won > 0) & (reach > 0) & ((ratio >= overlap) if inclusive else (ratio > overlap))
        index = np.append(np.where(good, np.cumsum(good) - 1, -1), -1)[index]  # -1 stays -1
        number, score, query = number[good], score[good], query[good]
        if merge:
            first = _first_of_stuff(number, table)
            index = np.append(first, -1)[index]
        candidates = outputs["classes"].shape[1]
        return Found(number, score, index=index, query=query, candidates=candidates)

    none = 1 if settings["score"] == "softmax" else 0
    return Decoder(decode, {"classes": (3, 2, table.count + none), "masks": (4, 0, 1)})


def _first_of_stuff(number: np.ndarray, table: ClassTable) -> np.ndarray:
    """For each segment itself, or for stuff the first segment of the same class; int (n,)."""
    first: dict[int, int] = {}
    return np.array(
        [k if n in table.things else first.setdefault(n, k) for k, n in enumerate(number.tolist())],
        np.int64,
    )


def _scores(kind: str) -> Callable[[np.ndarray, float], tuple[np.ndarray, ...]]:
    """logits (q, c), threshold -> score (q,), class (q,), whether kept (q,)."""

    def softmax_with_none(logits: np.ndarray, threshold: float) -> tuple[np.ndarray, ...]:
        share = softmax(logits)
        score, number = share.max(1), share.argmax(1)
        return score, number, (number != logits.shape[1] - 1) & (score > threshold)

    def maskdino(logits: np.ndarray, threshold: float) -> tuple[np.ndarray, ...]:
        single = sigmoid(logits)
        # The published settings sharpen the score after the threshold: temperature 0.06.
        return softmax(single / 0.06).max(1), single.argmax(1), single.max(1) > threshold

    return {"softmax": softmax_with_none, "maskdino": maskdino}[kind]


def _resized(values: np.ndarray, geometry: Geometry, settings: dict[str, Any]) -> np.ndarray:
    """A query's mask logits -> probabilities at the image's size, float32 (height, width)."""
    values, when = values.astype(np.float32), settings.get("sigmoid", "first")
    if when == "first":
        values = sigmoid(values)
    if through := settings.get("through"):
        size = (geometry.input_height, geometry.input_width) if through == "input" else through
        values = masks.resize(values, size[0], size[1], (1.0, 1.0))
    if when == "between":
        values = sigmoid(values)
    used = (
        geometry.used_height / geometry.input_height,
        geometry.used_width / geometry.input_width,
    )
    values = masks.resize(values, geometry.height, geometry.width, used)
    return sigmoid(values) if when == "last" else values


def sigmoid(values: np.ndarray) -> np.ndarray:
    """1 / (1 + exp(-x)), without overflow."""
    return 0.5 * (1 + np.tanh(0.5 * values))


def softmax(values: np.ndarray) -> np.ndarray:
    """Softmax over the last axis."""
    values = np.exp(values - values.max(-1, keepdims=True))
    return values / values.sum(-1, keepdims=True)
