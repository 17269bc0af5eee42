"""What the depth stage says of its output: the depths it read, and whether y runs the right way."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..common.errors import RsaDataError
from ..datasets.dataset import Dataset

COLUMNS = ("width", "height", "kind", "relative", "metric", "n_valid", "fit_scale")

# Rows of a part, and pixels of a map, that are looked at.
_ROWS, _PIXELS = 50, 2000

# Files of the ground truth that are read once more, since a table holds training pixels of the
# stated range alone; and the share of values outside it that is still usual (sky, mirrors).
_FILES, _OUTSIDE = 5, 0.05

# m. Indoor and outdoor datasets lie above it; what is below was read in the wrong unit.
_SMALLEST_MEDIAN = 0.1


def write(
    parts: Iterable[pa.Table],
    *inputs: pa.Table,
    depth_model: str | None = None,
    dataset: Dataset | None = None,
    root: Path | None = None,
    **options: Any,
) -> list[str]:
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
    beyond = [] if dataset is None or root is None else list(_outside(inputs[0], dataset, root))
    if not depth:
        return beyond
    metres = np.concatenate(depth)
    lines = [
        f"ground truth: {_spread(metres)} m, {np.mean(shares):.0%} of the pixels valid; "
        f"y: {_spread(np.concatenate(y))}"
    ]
    lines += beyond
    if np.median(metres) < _SMALLEST_MEDIAN:
        lines.append("warning: the ground truth is very near: is its unit (depth_unit) right?")
    if scales and np.mean(np.less(scales, 0)) > 0.5:
        lines.append(f"warning: {wrong_way(float(np.mean(np.less(scales, 0))), depth_model or '')}")
    return lines


def _outside(samples: pa.Table, dataset: Dataset, root: Path) -> Iterator[str]:
    """A warning when much of the ground truth lies outside the range that the dataset states."""
    paths = [path for path in samples["depth"].to_pylist() if path is not None]
    read = []
    for path in paths[:: max(1, len(paths) // _FILES)][:_FILES]:
        try:
            read.append(dataset.read_depth(root / path).ravel())
        except RsaDataError:
            continue  # a failed row of the table
    values = np.concatenate(read) if read else np.zeros(0, np.float32)
    values = values[np.isfinite(values) & (values > 0)]
    for what, limit, out in (
        ("below", dataset.min_depth, values <= dataset.min_depth),
        ("beyond", dataset.max_depth, values >= dataset.max_depth),
    ):
        if len(values) and out.mean() > _OUTSIDE:
            yield (
                f"warning: {out.mean():.0%} of the ground truth lies {what} {limit:g} m, where "
                f"{dataset.name} says that its range ends, and is left out; largest value: "
                f"{values.max():.3g} m. Is its unit (depth_unit) right?"
            )


def wrong_way(share: float, depth_model: str) -> str:
    """What to say of y that grows with the distance in this share of the images."""
    way = (
        "If the files hold depth, run depth with --files-hold depth"
        if depth_model.partition(":")[0] == "files"
        else 'If the model answers with depth, its card needs output = "depth"'
    )
    return (
        f"in {share:.0%} of the images y grows with the distance (the fit's scale is "
        f"negative), although larger y is to mean nearer. {way}"
    )


def _spread(values: np.ndarray) -> str:
    low, middle, high = np.percentile(values.astype(np.float64), (1, 50, 99))
    return f"median {middle:.3g}, 1 to 99%: {low:.3g} to {high:.3g}"
