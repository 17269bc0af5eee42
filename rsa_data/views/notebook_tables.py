"""What a notebook gives, checked, as the tables that stages read."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from ..common import calls
from ..common.errors import UsageError
from ..store import schemas


def objects(place: int, image: Any) -> list[dict[str, Any]]:
    """The objects of one image with every field that they may have."""
    if isinstance(image, (str, bytes, Mapping)) or not hasattr(image, "__iter__"):
        raise UsageError(
            f"write_captions: image {place}: expected a list of objects, found {image!r:.60}"
        )
    found = [_segment(given) for given in image]
    for one in found:
        calls.text(f"write_captions: image {place}: label", one["label"])
        area, box = one["area"], one["box"]
        if not isinstance(area, (float, int, np.number)) or not 0 <= area <= 1:
            raise UsageError(
                f"write_captions: image {place}: {one['label']}: expected an area of 0 to 1, a "
                f"share of the image; found {area!r:.40}"
            )
        if box is not None and np.shape(box) != (4,):
            raise UsageError(
                f"write_captions: image {place}: {one['label']}: expected a box (x1, y1, x2, y2) "
                f"in px; found {box!r:.60}"
            )
    return found


def _segment(given: Mapping[str, Any] | tuple[str, float]) -> dict[str, Any]:
    """One object with every field that it may have."""
    known = {"score": 1.0, "is_thing": True, "box": None}
    if isinstance(given, Mapping):
        strange = set(given) - {"label", "area", *known}
        if strange or not {"label", "area"} <= set(given):
            raise UsageError(
                "write_captions: expected label, area and maybe box, score and is_thing; found "
                f"{', '.join(given)}"
            )
        return {**known, **given}
    if isinstance(given, (str, bytes)) or len(np.shape(given) or ()) != 1 or len(given) != 2:
        raise UsageError(
            "write_captions: expected each object as (label, area) or a mapping, and for each "
            f"image a list of them; found {given!r:.60}"
        )
    return {**known, "label": given[0], "area": given[1]}


def segments_table(ids: list[str], images: list[list[dict[str, Any]]]) -> pa.Table:
    """Segments as importers of lists give them; images : of `objects`, by ids."""
    n = len(ids)
    boxes = [[s["box"] for s in image] for image in images]
    columns: dict[str, Any] = {name: [None] * n for name in schemas.schema("segments").names}
    columns |= {"sample_id": ids, "status": ["ok"] * n}
    columns |= {
        name: [[s[name] for s in image] for image in images]
        for name in ("label", "score", "area", "is_thing")
    }
    columns["box"] = [None if any(b is None for b in found) else found for found in boxes]
    columns["center"] = [
        None if b is None else [((x0 + x1) / 2, (y0 + y1) / 2) for x0, y0, x1, y1 in b]
        for b in columns["box"]
    ]
    return schemas.from_columns("segments", columns)


def samples_table(ids: list[str]) -> pa.Table:
    """Samples without files."""
    n = len(ids)
    columns: dict[str, Any] = {name: [None] * n for name in schemas.schema("samples").names}
    columns |= {"sample_id": ids, "dataset": ["notebook"] * n, "split": ["train"] * n}
    return schemas.from_columns("samples", columns | {"scene": ["."] * n})
