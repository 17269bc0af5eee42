"""What a scale for each region could gain: fits in each segment that has a mask, as a bound."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..common.errors import RowError, RsaDataError
from ..heads.belong import Source
from ..segments import masks
from ..store.tables import WorkDir
from . import oracles
from .inputs import Image, TestPart
from .methods import Method, Prediction
from .setting import segments_of

# Pixels that a half of a region needs for a fit of its own; with fewer the image's own fit holds.
_FEWEST = 16


def region_methods(work: WorkDir, source: Source, part: TestPart) -> Mapping[str, Method]:
    """The oracles by region, by their names in tables; none where the segments have no masks.

    source : of a head, whose captions or objects say which segments.
    """
    name = segments_of(work, source)
    if name is None or part.number not in work.table(source.dataset, name).parts():
        return {}
    column = work.table(source.dataset, name).read(part.number, ["mask"])["mask"]
    if column.null_count == len(column):
        return {}
    return {
        "linear fit a region": by_regions(name, fitted),
        "linear fit, scale a region": by_regions(name, rescaled),
    }


# y, ground truth and depth by the image's linear fit, both m, each (n,); the pixels of a region's
# half, and those of the other -> depth of the other half's pixels in m, or None where the half
# leaves it open.
Fit = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray | None]


def fitted(
    y: np.ndarray, gt: np.ndarray, linear: np.ndarray, on: np.ndarray, at: np.ndarray
) -> np.ndarray | None:
    """Scale and shift of a region's own: least squares of 1 / gt on y, as the linear fit."""
    found = oracles.inverse_least_squares(y[on], gt[on])
    return None if found is None else oracles.metric(y[at], *found)


def rescaled(
    y: np.ndarray, gt: np.ndarray, linear: np.ndarray, on: np.ndarray, at: np.ndarray
) -> np.ndarray | None:
    """The image's linear fit times a region's own factor, the median of the ratios there."""
    factor = np.median(gt[on] / linear[on])
    return linear[at] * factor if factor > 0 else None


def by_regions(
    segments: str,
    fit: Fit,
    regions: Callable[[Mapping[str, Any], tuple[int, ...]], np.ndarray] | None = None,
) -> Method:
    """Depth by a fit in each region, fitted on one half of its pixels and measured on the other.

    Every second pixel of a region, row by row, is one half; each half gets the fit of the other, so
    that every pixel counts and none has seen its own ground truth. Neighbours resemble each other,
    so this is more than anything that reads the image could reach: a bound. A pixel belongs to the
    smallest segment over it; those in none are one region. Where a half has fewer than 16 pixels,
    or leaves the fit open, the image's linear fit holds.

    regions : (row of the segments table, shape of the map) -> number of each pixel's region, in
    place of `region_of`.
    """
    divide = regions or region_of

    def method(part: TestPart) -> Callable[[Image], Prediction]:
        columns = ["sample_id", "status", "width", "height", "area", "mask"]
        table = part.work.table(part.dataset, segments).read(part.number, columns)
        found = {row["sample_id"]: row for row in table.to_pylist()}

        def predict(image: Image) -> Prediction:
            row = found.get(image.sample["sample_id"])
            if row is None or row["mask"] is None:
                raise RowError("no masks")
            whole = oracles.inverse_least_squares(image.y, image.gt)
            if whole is None:
                raise RowError("the relative depth leaves this fit open")
            linear = oracles.metric(image.y, *whole)
            depth = linear.copy()
            for half, other in halves(divide(row, image.valid.shape)[image.valid]):
                own = fit(image.y, image.gt, linear, half, other)
                if own is not None:
                    depth[other] = own
            return Prediction(depth)

        return predict

    return method


def halves(region: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """(pixels of a half, pixels of the other) of each region and both ways round, int64.

    region : int of shape (n,), the region of each pixel.
    """
    order = np.argsort(region, kind="stable")
    starts = np.flatnonzero(np.diff(region[order], prepend=region[order][:1] - 1))
    found = []
    for pixels in np.split(order, starts[1:]):
        even, odd = pixels[::2], pixels[1::2]
        if len(odd) >= _FEWEST:
            found += [(even, odd), (odd, even)]
    return found


def region_of(row: Mapping[str, Any], shape: tuple[int, ...]) -> np.ndarray:
    """Number of the region of each pixel of a map, int64 of that shape; 0 for no segment's.

    row : of a segments table: width, height, area and mask. Raises RowError where masks cannot be
    read.
    """
    try:
        regions = masks.decode(row["mask"], row["height"], row["width"])
    except RsaDataError as error:
        raise RowError(str(error)) from error
    index = np.zeros((row["height"], row["width"]), np.int64)
    for k in np.argsort(-np.asarray(row["area"], np.float64), kind="stable"):
        index[np.asarray(regions[k], bool)] = k + 1
    height, width = shape
    rows = np.arange(height) * row["height"] // height
    columns = np.arange(width) * row["width"] // width
    found: np.ndarray = index[np.ix_(rows, columns)]
    return found
