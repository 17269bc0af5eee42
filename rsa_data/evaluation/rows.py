"""The evaluation itself: methods over the images of a test split -> the metrics table."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from ..common.errors import RowError
from .depth_errors import clip, errors_of_valid
from .inputs import Image, TestPart
from .methods import Method, Prediction
from .metrics_table import to_table
from .protocols import Rules


def measure(
    parts: Sequence[TestPart],
    methods: Mapping[str, Method],
    rules: Rules,
    bar: Callable[[str, int], Any] | None = None,
) -> pa.Table:
    """A row for each image and method: a table of schemas/metrics.toml, in that order.

    bar : (title, number of images) -> what shows progress, with update(images) and close().
    """
    rows: list[dict[str, Any]] = []
    total = sum(len(part.samples) for part in parts)
    shown = bar(f"{parts[0].dataset} evaluate", total) if bar and parts else None
    for part in parts:
        predictors = {name: method(part) for name, method in methods.items()}
        for sample, image in part.images(rules):
            about = {key: sample[key] for key in ("sample_id", "dataset", "scene")}
            for name, predict in predictors.items():
                rows.append({**about, "method": name, **_row(image, predict, rules)})
            if shown:
                shown.update(1)
    if shown:
        shown.close()
    return to_table(rows)


def _row(
    image: Image | RowError | None, predict: Callable[[Image], Prediction], rules: Rules
) -> dict[str, Any]:
    if image is None:
        return {"status": "skipped", "error": "no ground-truth depth is listed"}
    if isinstance(image, RowError):
        return {"status": "failed", "error": str(image)}
    try:
        prediction = predict(image)
    except RowError as error:
        return {"status": "failed", "error": str(error), "n_valid": len(image.gt)}
    depth = prediction.depth
    if rules.beyond == "near" and prediction.scale is not None and prediction.shift is not None:
        depth = np.where(prediction.scale * image.y + prediction.shift < 0, rules.min_depth, depth)
    if rules.median_scaled:
        depth = depth * (np.median(image.gt) / np.median(depth))
    return {
        "status": "ok",
        "n_valid": len(image.gt),
        "scale": prediction.scale,
        "shift": prediction.shift,
        **errors_of_valid(image.gt, clip(depth, rules.min_depth, rules.max_depth)),
    }
