"""Reading label maps: PNG files whose pixels are numbers, not colours."""

from pathlib import Path

import numpy as np

from ..common.errors import RowError
from ..datasets.pixel_files import read_png
from . import frames


def read_numbers(path: Path) -> np.ndarray:
    """A PNG of one channel, 1, 2, 4, 8 or 16 bits, grey or palette (its indices): int32 (h, w).

    Raises RowError, without the path, for anything else.
    """
    png = read_png(path, "a PNG label map")
    if png.values.ndim != 2:
        raise RowError(f"expected a label map of one channel, found a PNG of {png.described()}")
    return png.values.astype(np.int32)


def read_colour_ids(path: Path) -> np.ndarray:
    """A colour PNG whose pixels are ids, R + 256 G + 65536 B (COCO panoptic): int32 (h, w).

    Raises RowError, without the path, for anything else.
    """
    png = read_png(path, "a PNG of ids in RGB")
    if png.bits != 8 or png.values.ndim != 3 or png.values.shape[2] < 3:
        raise RowError(f"expected a PNG of ids in RGB of 8 bits, found one of {png.described()}")
    ids: np.ndarray = png.values[:, :, :3].astype(np.int32) @ np.array([1, 256, 65536], np.int32)
    return ids


def fitted(numbers: np.ndarray, root: Path | None, image: str | None, what: str) -> np.ndarray:
    """The map as it lies on the displayed image below `root`; unchanged where that is not there.

    A map of the stored pixels of an image that EXIF turns is turned as well.
    Raises RowError unless the map has the image's displayed size, or else its stored one.
    """
    frame = frames.of_image(root, image)
    height, width = numbers.shape
    if frame is None or (frame.orientation == 1 and (width, height) == frame.stored):
        return numbers
    if (width, height) == (frame.width, frame.height) == frame.stored:
        raise RowError(
            f"{what}: the image is turned for display (EXIF orientation {frame.orientation}), and "
            "whether the map is cannot be told. Write the image upright"
        )
    if (width, height) == (frame.width, frame.height):
        return numbers
    if (width, height) == frame.stored:
        return frames.turned(numbers, frame.orientation)
    transposed = ", which is transposed" if (height, width) == (frame.width, frame.height) else ""
    raise RowError(
        f"{what}: expected the image's size {frame.width} x {frame.height}, found {width} x "
        f"{height}{transposed}"
    )
