"""Decoders of graphs that answer with final detections: suppression is inside the graph."""

from typing import Any

import numpy as np

from ..common.class_names import ClassTable
from ..common.errors import unknown
from . import masks
from .decoding import Decoder, Outputs
from .found import Found
from .preprocess import Geometry


def rows(settings: dict[str, Any], table: ClassTable) -> Decoder:
    """PaddleDetection: `rows` (n, 6) = class, score, x1, y1, x2, y2; one row of class -1 is none.

    coordinates : image, px of the image, for graphs with a scale_factor input; or input.
    """
    threshold, to_image = settings["score_threshold"], coordinates(settings)

    def decode(outputs: Outputs, geometry: Geometry) -> Found:
        found = outputs["rows"]  # (n, 6)
        kept = np.flatnonzero((found[:, 0] >= 0) & (found[:, 1] > threshold))
        kept = kept[np.argsort(-found[kept, 1], kind="stable")]
        number, score = found[kept, 0].astype(np.int64), found[kept, 1]
        box = to_image(found[kept, 2:], geometry)
        return Found(number, score, box, query=kept, candidates=len(found))

    return Decoder(decode, {"rows": (2, 1, 6)}, batched=False)


def instances(settings: dict[str, Any], table: ClassTable) -> Decoder:
    """Detic, Mask R-CNN: `boxes` (n, 4) x1 y1 x2 y2, `scores` (n,), `classes` (n,), `masks`.

    masks : (n, h, w) or (n, 1, h, w), probabilities.
    masks_show : box, each mask covers its box (28 x 28); input, each covers the whole input.
    mask_threshold : probability from which a pixel belongs to the mask.
    coordinates : of the boxes: image or input, px.
    """
    threshold, to_image = settings["score_threshold"], coordinates(settings)
    border = settings.get("mask_threshold", 0.5)
    show = settings.get("masks_show", "box")
    if show not in ("box", "input"):
        raise unknown("masks_show", show, ("box", "input"))

    def decode(outputs: Outputs, geometry: Geometry) -> Found:
        score = outputs["scores"]  # (n,)
        kept = np.flatnonzero(score > threshold)
        kept = kept[np.argsort(-score[kept], kind="stable")]
        box = to_image(outputs["boxes"][kept], geometry)
        each = outputs["masks"][kept].astype(np.float32)
        each = each.reshape(len(kept), *each.shape[-2:])  # (n, h, w)
        height, width = geometry.height, geometry.width
        pasted = [
            masks.paste(mask, corners, height, width) >= border
            if show == "box"
            else masks.resize(mask, height, width, geometry.shown) >= border
            for mask, corners in zip(each, box, strict=True)
        ]
        number = outputs["classes"][kept].astype(np.int64)
        return Found(number, score[kept], masks=pasted, query=kept, candidates=len(score))

    roles = {"boxes": (2, 1, 4), "scores": (1, 0, 1), "classes": (1, 0, 1)}
    axes = settings.get("mask_axes", 4)
    return Decoder(decode, roles | {"masks": (axes, 0, 1)}, batched=False)


def coordinates(settings: dict[str, Any]) -> Any:
    """What turns boxes x1 y1 x2 y2 of a graph into px of the image, by `coordinates`."""
    kinds = {
        "image": lambda box, geometry: np.asarray(box, np.float64),
        "input": lambda box, geometry: geometry.to_image(box),
        "shares": lambda box, geometry: geometry.to_image(
            box * np.tile([geometry.input_width, geometry.input_height], 2)
        ),
    }
    kind = settings.get("coordinates", "image")
    if kind not in kinds:
        raise unknown("coordinates", kind, kinds)
    return kinds[kind]
