"""Reading label maps: PNG files whose pixels are numbers, not colours."""

import io
from pathlib import Path

import numpy as np

from ..common.errors import RowError
from ..datasets import images


def read_numbers(path: Path) -> np.ndarray:
    """A one-channel PNG of 1, 8 or 16 bits, or with a palette (then its indices): int32 (h, w).

    Raises RowError, without the path, for anything else.
    """
    values, mode = _decode(path)
    if values.ndim != 2:
        raise RowError(f"expected a label map of one channel, found a PNG of mode {mode}")
    return values.astype(np.int32)


def read_colour_ids(path: Path) -> np.ndarray:
    """A colour PNG whose pixels are ids, R + 256 G + 65536 B (COCO panoptic): int32 (h, w).

    Raises RowError, without the path, for anything else.
    """
    values, mode = _decode(path)
    if values.ndim != 3 or values.shape[2] < 3:
        raise RowError(f"expected a PNG of ids in RGB, found one of mode {mode}")
    return values[:, :, :3].astype(np.int32) @ np.array([1, 256, 65536], np.int32)


def _decode(path: Path) -> tuple[np.ndarray, str]:
    from PIL.PngImagePlugin import PngImageFile

    data = images.read_bytes(path)
    try:
        with PngImageFile(io.BytesIO(data)) as image:
            width, height = image.size
            if width * height > images.MAX_PIXELS:
                raise RowError(f"label map of {width} x {height} px: more than is read")
            image.load()
            return np.asarray(image), image.mode
    except (RowError, MemoryError):
        raise
    except Exception as error:  # Pillow's decoders raise nearly every built-in kind
        raise RowError(f"expected a PNG label map; reading it failed: {error}") from error


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
