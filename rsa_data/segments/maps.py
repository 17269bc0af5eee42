"""Reading label maps: PNG files whose pixels are numbers, not colours."""

from pathlib import Path

import numpy as np

from ..common.errors import RowError
from ..datasets import images
from ..datasets.pixel_files import read_png


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


def check_size(numbers: np.ndarray, root: Path | None, image: str | None, what: str) -> None:
    """Raises RowError unless a map has the size of the image below `root`, where it is there."""
    if root is None or image is None:
        return
    try:
        width, height = images.image_size(root / image)
    except RowError as error:
        if str(error) == images.MISSING:
            return
        raise RowError(f"{image}: {error}") from error
    if numbers.shape != (height, width):
        found = f"{numbers.shape[1]} x {numbers.shape[0]}"
        raise RowError(f"{what}: expected the image's size {width} x {height}, found {found}")
