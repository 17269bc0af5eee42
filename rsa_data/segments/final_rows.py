"""Decoders of final rows and final boxes, by a card that names their columns."""

from typing import Any

import numpy as np

from ..common.class_names import ClassTable
from ..common.errors import RsaDataError
from .decoding import Decoder, Outputs
from .found import Found
from .inside_nms import coordinates
from .preprocess import Geometry
from .yolo import of_prototypes

_CORNERS, _CENTRE = ("x1", "y1", "x2", "y2"), ("x", "y", "w", "h")


def final_rows(settings: dict[str, Any], table: ClassTable) -> Decoder:
    """`rows` (n, k) or (1, n, k) of final detections; a row with score 0 or class -1 is none.

    columns : their names in order, of x1 y1 x2 y2 score class batch, or x y w h (centre and size)
        instead of the corners; others may be named `-`.
    axes : 2 or 3. prototypes : how many mask terms follow the columns; see yolo.
    coordinates : image or input (px), or shares of the input.
    """
    columns, axes = settings["columns"], settings.get("axes", 2)
    planes, threshold = settings.get("prototypes", 0), settings["score_threshold"]
    to_image = coordinates(settings)
    sides = _CENTRE if set(columns) >= set(_CENTRE) else _CORNERS
    if not set(columns) >= {*sides, "score", "class"}:
        raise RsaDataError(
            f"final-rows: expected columns with class, score, and {', '.join(_CORNERS)} or "
            f"{', '.join(_CENTRE)}; found {columns}"
        )
    place = {name: k for k, name in enumerate(columns)}

    def decode(outputs: Outputs, geometry: Geometry) -> Found:
        rows = outputs["rows"].reshape(-1, outputs["rows"].shape[-1])  # (n, k)
        score, number = rows[:, place["score"]], rows[:, place["class"]]
        kept = np.flatnonzero((number >= 0) & (score > threshold))
        kept = kept[np.argsort(-score[kept], kind="stable")]
        given = rows[kept][:, [place[side] for side in sides]].astype(np.float64)  # (k, 4)
        if sides == _CENTRE:
            half = given[:, 2:] / 2
            given = np.concatenate([given[:, :2] - half, given[:, :2] + half], 1)
        box = to_image(given, geometry)
        found = Found(number[kept].astype(np.int64), score[kept], box)
        if not planes:
            return found
        drawn = of_prototypes(rows[kept, -planes:], outputs["prototypes"][0], box, geometry)
        return Found(found.number, found.score, masks=drawn)

    roles = {"rows": (axes, axes - 1, len(columns) + planes)}
    return Decoder(decode, roles | ({"prototypes": (4, 1, planes)} if planes else {}), axes == 3)


def final_boxes(settings: dict[str, Any], table: ClassTable) -> Decoder:
    """`boxes` (n, 4) x1 y1 x2 y2, `scores` (n,), `classes` (n,); or each with a batch of 1 before.

    axes : of `boxes`, 2 or 3. coordinates : image or input (px), or shares of the input.
    """
    threshold, axes = settings["score_threshold"], settings.get("axes", 2)
    to_image = coordinates(settings)

    def decode(outputs: Outputs, geometry: Geometry) -> Found:
        score, number = outputs["scores"].ravel(), outputs["classes"].ravel()
        kept = np.flatnonzero((number >= 0) & (score > threshold))
        kept = kept[np.argsort(-score[kept], kind="stable")]
        box = to_image(outputs["boxes"].reshape(-1, 4)[kept], geometry)
        return Found(number[kept].astype(np.int64), score[kept], box)

    roles = {"boxes": (axes, axes - 1, 4), "scores": (axes - 1, 0, 1), "classes": (axes - 1, 0, 1)}
    return Decoder(decode, roles, axes == 3)
