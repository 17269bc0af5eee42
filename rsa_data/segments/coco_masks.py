"""The pixel mask of one COCO result: polygons or run lengths, or its box where it has neither."""

import threading
import warnings
from typing import Any

import numpy as np

from ..common.errors import RowError
from ..common.extras import extras
from . import masks

_ALONE = threading.Lock()


def decode(result: dict[str, Any], width: int, height: int) -> np.ndarray:
    """The mask of a result, bool (height, width). Raises RowError for one of another size."""
    given = result.get("segmentation")
    if not given:
        return _of_box(result, width, height)
    with extras("segmentations"):
        from pycocotools import mask as coco_mask
    try:
        if isinstance(given, list):
            _check_polygons(given, height, width)
            given = coco_mask.merge(coco_mask.frPyObjects(given, height, width))
        elif isinstance(given, dict) and isinstance(given.get("counts"), list):
            given = coco_mask.frPyObjects(given, *given["size"])
        if not isinstance(given, dict):
            raise RowError(f"expected a segmentation as polygons or RLE, found {given!r}")
        if list(given["size"]) != [height, width]:
            raise RowError(f"mask of size {given['size']}: expected the image's {[height, width]}")
        if masks.covered(given["counts"]) != height * width:
            # pycocotools would leave the rest as whatever memory held.
            raise RowError(f"run lengths: expected {height * width} pixels in all, found others")
        # What catch_warnings changes is the whole process's.
        with _ALONE, warnings.catch_warnings():
            # pycocotools' arrays do not know numpy 2's copy argument yet.
            warnings.simplefilter("ignore", DeprecationWarning)
            mask: np.ndarray = coco_mask.decode(given).astype(bool)
            return mask
    except RowError:
        raise
    except Exception as error:  # pycocotools raises nearly every built-in kind
        raise RowError(f"expected a segmentation as RLE or polygons: {error}") from error


def _of_box(result: dict[str, Any], width: int, height: int) -> np.ndarray:
    """The pixels whose centres lie in the result's box."""
    x, y, w, h = result["bbox"]
    columns, rows = np.arange(width) + 0.5, np.arange(height) + 0.5
    across = (columns >= x) & (columns < x + w)
    down = (rows >= y) & (rows < y + h)
    return np.asarray(down[:, None] & across[None])


def _check_polygons(polygons: list[Any], height: int, width: int) -> None:
    """Points far outside would take memory by their distance; all within 0 to 1 are shares."""
    for polygon in polygons:
        # pycocotools takes four numbers for a box x, y, width, height.
        if not isinstance(polygon, list) or len(polygon) < 6 or len(polygon) % 2:
            raise RowError(
                f"polygon: expected lists of three points or more, x and y of each; found "
                f"{str(polygon)[:60]}"
            )
    points = np.concatenate([np.asarray(polygon, np.float64).ravel() for polygon in polygons])
    most = 2 * max(height, width)
    if not (np.abs(points) <= most).all():
        raise RowError(f"polygon: expected points in the image, found one beyond {most} px")
    if (points <= 1).all() and min(height, width) > 8:
        raise RowError("polygon: expected points in px, found shares of the image, all 0 to 1")


def check_meets_box(result: dict[str, Any], mask: np.ndarray) -> None:
    """Raises RowError for a mask without any pixel in the box that the same result gives."""
    box: list[float] = result.get("bbox") or []
    if len(box) != 4 or not result.get("segmentation") or not mask.any():
        return
    x, y, w, h = box
    inside = mask[max(0, int(y) - 1) : int(y + h) + 2, max(0, int(x) - 1) : int(x + w) + 2]
    if not inside.any():
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        raise RowError(
            f"expected the segmentation to lie in its bbox {list(box)}; found it from x "
            f"{columns[0]} to {columns[-1]} and y {rows[0]} to {rows[-1]}. Are x and y exchanged?"
        )
