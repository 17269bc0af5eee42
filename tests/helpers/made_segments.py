"""Segments and samples tables of a few images, for tests of captions."""

from typing import Any

import pyarrow as pa

from rsa_data.store import schemas


def segments(
    images: dict[str, list[dict[str, Any]]], *, split: str = "train", **row: Any
) -> pa.Table:
    """A segments table: {key: [{label, area, and maybe center, is_thing}, ...]}.

    row : values that every row has, such as status or width.
    """
    rows = []
    for key, found in images.items():
        centers = [s["center"] for s in found] if found and "center" in found[0] else None
        rows.append(
            {
                "sample_id": f"nyuv2/{split}/{key}",
                "status": "ok",
                "label": [s["label"] for s in found],
                "score": [1.0] * len(found),
                "area": [s["area"] for s in found],
                "is_thing": [s.get("is_thing", True) for s in found],
                "center": centers,
                "cell": centers and [_cell(*center) for center in centers],
                **row,
            }
        )
    names = schemas.schema("segments").names
    return schemas.from_columns("segments", {n: [r.get(n) for r in rows] for n in names})


def _cell(x: float, y: float) -> int:
    """The cell of a small object at x, y in an image of 640 x 480 px."""
    return 3 * int(3 * y // 480) + int(3 * x // 640)


def samples(of: pa.Table, **row: Any) -> pa.Table:
    """The samples table of a segments table; row : values that every row has, such as fx."""
    rows = [
        {"sample_id": s, "dataset": "nyuv2", "split": "train", "scene": "room", **row}
        for s in of["sample_id"].to_pylist()
    ]
    names = schemas.schema("samples").names
    return schemas.from_columns("samples", {n: [r.get(n) for r in rows] for n in names})


def objects(*found: tuple[str, float] | tuple[str, float, tuple[float, float]]) -> list[dict]:
    """Segments from (label, area) or (label, area, center)."""
    names = ("label", "area", "center")
    return [dict(zip(names, values, strict=False)) for values in found]
