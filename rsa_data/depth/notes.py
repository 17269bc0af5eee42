"""What the depth stage says of its output: the depths it read, and whether y runs the right way."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pyarrow as pa

COLUMNS = ("width", "height", "kind", "relative", "metric", "n_valid", "fit_scale")

# Rows of a part, and pixels of a map, that are looked at.
_ROWS, _PIXELS = 50, 2000

# m. Indoor and outdoor datasets lie above it; what is below was read in the wrong unit.
_SMALLEST_MEDIAN = 0.1


def write(parts: Iterable[pa.Table], *_: pa.Table, depth_model: str, **options: Any) -> list[str]:
    """Sentences on the ground truth and the relative depth of some parts of the table."""
    depth, y, shares, scales = [], [], [], []
    for part in parts:
        for row in part.slice(0, _ROWS).to_pylist():
            if row["metric"] is None:
                continue
            metric, relative = (np.frombuffer(row[c], "<f2") for c in ("metric", "relative"))
            step = -(-len(metric) // _PIXELS)
            there = (metric[::step] > 0) & np.isfinite(relative[::step])
            depth.append(metric[::step][there].astype(np.float32))
            y.append(relative[::step][there].astype(np.float32))
            shares.append(row["n_valid"] / (row["width"] * row["height"]))
            if row["fit_scale"] is not None:
                scales.append(row["fit_scale"])
    if not depth:
        return []
    metres = np.concatenate(depth)
    lines = [
        f"ground truth: {_spread(metres)} m, {np.mean(shares):.0%} of the pixels valid; "
        f"y: {_spread(np.concatenate(y))}"
    ]
    if np.median(metres) < _SMALLEST_MEDIAN:
        lines.append("warning: the ground truth is very near: is its unit (depth_unit) right?")
    if scales and np.mean(np.less(scales, 0)) > 0.5:
        lines.append(wrong_way(float(np.mean(np.less(scales, 0))), depth_model))
    return lines


def wrong_way(share: float, depth_model: str) -> str:
    """The warning for y that grows with the distance in this share of the images."""
    way = (
        "If the files hold depth, say --files-hold depth"
        if depth_model.partition(":")[0] == "files"
        else 'If the model answers with depth, its card needs output = "depth"'
    )
    return (
        f"warning: in {share:.0%} of the images y grows with the distance (the fit's scale is "
        f"negative), although larger y is to mean nearer. {way}"
    )


def _spread(values: np.ndarray) -> str:
    low, middle, high = np.percentile(values.astype(np.float64), (1, 50, 99))
    return f"median {middle:.3g}, 1 to 99%: {low:.3g} to {high:.3g}"
