"""Decoder of YOLO graphs whose boxes are decoded inside: Ultralytics v5 to v11, YOLOX decoded."""

from typing import Any

import numpy as np

from ..common.class_names import ClassTable
from . import masks
from .boxes import suppress
from .decoding import Decoder, Outputs, sigmoid
from .found import Found
from .preprocess import Geometry


def yolo(settings: dict[str, Any], table: ClassTable) -> Decoder:
    """`predictions` = x, y, w, h (px of the input, centre), maybe objectness, classes, mask terms.

    objectness : whether a column of it stands before the classes (v5, v7, YOLOX): score =
        objectness * class; without it the class's score itself (v8 to v11).
    columns_first : (1, columns, n), as v8 and later have it; otherwise (1, n, columns).
    prototypes : how many, for graphs that segment: `prototypes` (1, p, h, w) over the input; a
        mask is where sigmoid(terms @ prototypes) is above 0.5 inside the box.
    overlap_threshold : of suppression; 1 for graphs that need none (RT-DETR).
    coordinates : input, px; or shares of the input.
    """
    threshold, overlap = settings["score_threshold"], settings.get("overlap_threshold", 0.45)
    skip = 5 if settings.get("objectness", False) else 4
    first, planes = settings.get("columns_first", False), settings.get("prototypes", 0)
    shares = settings.get("coordinates") == "shares"

    def decode(outputs: Outputs, geometry: Geometry) -> Found:
        rows = outputs["predictions"][0]
        rows = rows.T if first else rows  # (n, columns)
        classes = rows[:, skip : skip + table.count]
        number = classes.argmax(1)
        score = classes[np.arange(len(rows)), number]
        if skip == 5:
            score = score * rows[:, 4]
        kept = np.flatnonzero(score > threshold)
        center, size = rows[kept, :2].astype(np.float64), rows[kept, 2:4].astype(np.float64)
        box = np.concatenate([center - size / 2, center + size / 2], 1)
        if shares:
            box *= np.tile([geometry.input_width, geometry.input_height], 2)
        alive = suppress(box, score[kept], number[kept], overlap)
        kept, box = kept[alive], geometry.to_image(box[alive])
        found = Found(number[kept], score[kept], box, query=kept, candidates=len(rows))
        if not planes:
            return found
        drawn = of_prototypes(rows[kept, -planes:], outputs["prototypes"][0], box, geometry)
        return Found(found.number, found.score, masks=drawn, query=kept, candidates=len(rows))

    columns = skip + table.count + planes
    roles = {"predictions": (3, 1 if first else 2, columns)}
    return Decoder(decode, roles | ({"prototypes": (4, 1, planes)} if planes else {}))


def of_prototypes(
    terms: np.ndarray, prototypes: np.ndarray, box: np.ndarray, geometry: Geometry
) -> list[np.ndarray]:
    """Bool masks (height, width), cut to their boxes, of terms (n, p) and prototypes (p, h, w).

    box : x1 y1 x2 y2, px of the image.
    """
    height, width = geometry.height, geometry.width
    flat = prototypes.reshape(len(prototypes), -1).astype(np.float32)
    rows, columns = np.arange(height) + 0.5, np.arange(width) + 0.5
    drawn = []
    for term, (x1, y1, x2, y2) in zip(terms.astype(np.float32), box, strict=True):
        plane = sigmoid((term @ flat).reshape(prototypes.shape[1:]))
        mask = masks.resize(plane, height, width, geometry.shown) > 0.5
        mask &= ((rows >= y1) & (rows < y2))[:, None] & ((columns >= x1) & (columns < x2))
        drawn.append(mask)
    return drawn
