"""Decoders of models that answer with queries: each a class, and a box or a mask."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..common.class_names import ClassTable
from ..common.errors import unknown
from . import masks
from .decoding import Decoder, Outputs, sigmoid, softmax
from .found import Found
from .preprocess import Geometry


def detr(settings: dict[str, Any], table: ClassTable) -> Decoder:
    """DETR and its kin: `classes` (1, q, c) logits, `boxes` (1, q, 4) = cx, cy, w, h as shares.

    score : softmax, the last class being none: the best class of each query (DETR, YOLOS);
        sigmoid: the q best of all (query, class), so that a query may stand twice (RT-DETR,
        D-FINE). As transformers' post_process_object_detection does.
    """
    kind, threshold = settings["score"], settings["score_threshold"]
    if kind not in ("softmax", "sigmoid"):
        raise unknown("score", kind, ("softmax", "sigmoid"))

    def decode(outputs: Outputs, geometry: Geometry) -> Found:
        logits = outputs["classes"][0].astype(np.float32)  # (q, c)
        queries, classes = logits.shape
        if kind == "softmax":
            shares = softmax(logits)[:, :-1]
            score, number, query = shares.max(1), shares.argmax(1), np.arange(queries)
        else:
            shares = sigmoid(logits).ravel()  # (q * c,)
            order = np.argsort(-shares, kind="stable")[:queries]
            score, number, query = shares[order], order % classes, order // classes
        kept = score > threshold
        score, number, query = score[kept], number[kept], query[kept]
        center, size = np.split(outputs["boxes"][0, query].astype(np.float32), 2, axis=1)
        box = np.concatenate([center - size / 2, center + size / 2], 1)
        box = geometry.to_image(box * np.tile([geometry.input_width, geometry.input_height], 2))
        return Found(number, score, box, query=query, candidates=queries)

    none = 1 if kind == "softmax" else 0
    return Decoder(decode, {"classes": (3, 2, table.count + none), "boxes": (3, 2, 4)})


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
            np.copyto(best, value, where=wins)
            np.copyto(index, k, where=wins)
            if own:
                np.copyto(at_least, mask >= own, where=wins)
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

    kinds = {"softmax": softmax_with_none, "maskdino": maskdino}
    if kind not in kinds:
        raise unknown("score", kind, kinds)
    return kinds[kind]


def _resized(values: np.ndarray, geometry: Geometry, settings: dict[str, Any]) -> np.ndarray:
    """A query's mask logits -> probabilities at the image's size, float32 (height, width)."""
    values, when = values.astype(np.float32), settings.get("sigmoid", "first")
    if when == "first":
        values = sigmoid(values)
    if through := settings.get("through"):
        size = (geometry.input_height, geometry.input_width) if through == "input" else through
        values = masks.resize(values, size[0], size[1])
    if when == "between":
        values = sigmoid(values)
    values = masks.resize(values, geometry.height, geometry.width, geometry.shown)
    return sigmoid(values) if when == "last" else values
