"""The baseline from object sizes: how tall a thing is and looks tells how far away it stands."""

import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..common.class_names import clean
from ..common.errors import RowError
from ..heads.belong import Source
from ..store.tables import WorkDir
from .inputs import Image, TestPart
from .methods import Method, Prediction, scaled
from .setting import segments_of

# A box this near the border (px) is cut off, and its height is not the object's.
_BORDER = 2.0


@cache
def sizes() -> dict[str, tuple[float, float]]:
    """Class -> (mean height in m, relative spread), from sizes.toml, which names the sources."""
    table = tomllib.loads((Path(__file__).parent / "sizes.toml").read_text("utf-8"))
    return {name: (row["height"], row["spread"]) for name, row in table["size"].items()}


def scale_from_sizes(y: np.ndarray, inverse: np.ndarray, spread: np.ndarray) -> float | None:
    """The scale for which scale * y best equals the objects' inverse depth, shift 0.

    y : float64 (n,), relative depth of each object, positive. inverse : float64 (n,), 1/m, from
    its size: pixels tall / (focal length in px * metres tall). spread : of the size, relative,
    which is also that of the inverse depth. Least squares of the relative error, weighted by
    1 / spread^2: closed form. None without an object.
    """
    if not len(y):
        return None
    ratio, weight = y / inverse, 1.0 / np.square(spread)
    return float(np.sum(weight * ratio) / np.sum(weight * ratio * ratio))


def by_object_sizes(segments: str) -> Method:
    """Scale from the objects of known size in each image; `segments` : name of the table.

    Needs boxes and the focal length. Boxes at the image's border are left out. The height of a box
    is taken for the height of the thing, which holds for what stands upright and is seen from
    near its own height; for furniture seen from above it is too much.
    """

    def method(part: TestPart) -> Callable[[Image], Prediction]:
        table = part.work.table(part.dataset, segments).read(
            part.number, ["sample_id", "width", "height", "label", "box"]
        )
        found = {row["sample_id"]: row for row in table.to_pylist()}

        def predict(image: Image) -> Prediction:
            scale = scale_from_sizes(*objects_of(image, found.get(image.sample["sample_id"])))
            if scale is None:
                raise RowError("no object of known size that is wholly in the image")
            return scaled(image, scale, 0.0)

        return predict

    return method


def objects_of(
    image: Image, row: dict[str, Any] | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Relative depth, inverse depth and spread of the objects of known size, each (n,)."""
    focal = image.sample["fy"]
    if focal is None:
        raise RowError("the focal length is not known")
    if row is None or row["box"] is None:
        raise RowError("no boxes")
    height, width = image.relative.shape
    k = width / row["width"], height / row["height"]
    found = []
    for label, (x0, y0, x1, y1) in zip(row["label"], row["box"], strict=True):
        known = sizes().get(clean(label))
        cut = x0 < _BORDER or y0 < _BORDER
        cut |= x1 > row["width"] - _BORDER or y1 > row["height"] - _BORDER
        if known is None or cut or y1 - y0 < 1:
            continue
        # The middle of the box: its corners show what is behind.
        rows = slice(int(k[1] * (0.75 * y0 + 0.25 * y1)), int(k[1] * (0.25 * y0 + 0.75 * y1)) + 1)
        columns = slice(
            int(k[0] * (0.75 * x0 + 0.25 * x1)), int(k[0] * (0.25 * x0 + 0.75 * x1)) + 1
        )
        inside = image.relative[rows, columns].astype(np.float64)
        inside = inside[~np.isnan(inside)]
        y = float(np.median(inside)) if len(inside) else 0.0
        if y > 0:
            found.append((y, (y1 - y0) / (focal * known[0]), known[1]))
    columns_ = np.array(found, np.float64).reshape(-1, 3)
    return columns_[:, 0], columns_[:, 1], columns_[:, 2]


def has_sizes(work: WorkDir, source: Source, part: TestPart) -> str | None:
    """The segments table that the baseline can be made from: it has boxes, samples have fy."""
    if all(sample["fy"] is None for sample in part.samples):
        return None
    segments = segments_of(work, source)
    if segments is None or part.number not in work.table(source.dataset, segments).parts():
        return None
    boxes = work.table(source.dataset, segments).read(part.number, ["box"])["box"]
    return segments if boxes.null_count < len(boxes) else None
