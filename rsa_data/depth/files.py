"""Relative depth that lies in files: one .npy or 16-bit PNG an image."""

import io
import struct
from pathlib import Path
from typing import Any

import numpy as np

from ..common.errors import RowError, UsageError
from ..datasets.dataset import Dataset
from ..datasets.images import MAX_PIXELS, read_bytes
from .model import Relative, Source


def build(*, argument: str, dataset: Dataset, root: Path, holds: str, **_: Any) -> Source:
    """Reads the relative depth of `root/IMAGE.jpg` from `argument/IMAGE.npy` or `.png`.

    argument : the folder; empty for the files that the dataset itself brings.
    holds : what the files hold, `relative` (y as it is) or `depth` (y is the inverse).
    """
    if argument:
        folder = Path(argument)
        return lambda image: read(folder, str(Path(image).with_suffix("")), holds)
    of_dataset = dataset.relative
    if of_dataset is None:
        raise UsageError(
            f"depth model files: {dataset.name} brings no relative depth of its own; name the "
            "folder that holds it: --depth-model files:DIR"
        )
    return lambda image: read(root, str(Path(of_dataset(image)).with_suffix("")), holds)


def read(folder: Path, stem: str, holds: str = "relative") -> Relative:
    """The relative depth `folder/stem.npy`, or `.png`, see `read_map`.

    `relative` is taken as it is, a PNG's value / 65535, so 0 to 1; `depth` is in m, a PNG's in mm,
    and y is its inverse.
    """
    values = read_map(folder, stem, 65535 if holds == "relative" else 1000)
    return Relative(values if holds == "relative" else inverse(values))


def read_map(folder: Path, stem: str, unit: float) -> np.ndarray:
    """The map `folder/stem.npy`, or `folder/stem.png` when there is no such array.

    A .npy is a float or integer array of shape (h, w), NaN where there is nothing; a PNG has one
    channel of 16 bits, whose values are divided by `unit`. Returns float32 of shape (h, w).
    Raises RowError, naming the file relative to the folder.
    """
    if (folder / f"{stem}.npy").is_file():
        return _array(folder / f"{stem}.npy", f"{stem}.npy")
    if (folder / f"{stem}.png").is_file():
        return _png(folder / f"{stem}.png", f"{stem}.png") / np.float32(unit)
    raise RowError(f"{stem}: expected a map in {stem}.npy or .png; found neither")


def inverse(depth: np.ndarray) -> np.ndarray:
    """1 / depth as float32; NaN where the depth is not above 0 (a dead pixel, no measurement)."""
    valid = depth > 0
    return np.where(valid, 1 / np.where(valid, depth, 1), np.nan).astype(np.float32)


def _array(path: Path, name: str) -> np.ndarray:
    try:
        values = np.load(io.BytesIO(read_bytes(path)), allow_pickle=False)
    except RowError as error:
        raise RowError(f"{name}: {error}") from error
    except Exception as error:  # a damaged header raises anything from SyntaxError to MemoryError
        raise RowError(f"{name}: not a readable .npy array") from error
    values = np.squeeze(values)
    if values.ndim != 2 or values.dtype.kind not in "fiu" or not values.size:
        raise RowError(
            f"{name}: expected numbers of shape (height, width); found {values.dtype} "
            f"of shape {values.shape}"
        )
    return values.astype(np.float32)


def _png(path: Path, name: str) -> np.ndarray:
    import cv2

    data = read_bytes(path)
    # Width and height stand here in every PNG: a small file can announce more than memory holds.
    width, height = struct.unpack(">II", data[16:24].ljust(8, b"\0"))
    sound = data and width * height <= MAX_PIXELS
    values = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if sound else None
    if values is None:
        raise RowError(f"{name}: not a readable PNG")
    if values.dtype != np.uint16 or values.ndim != 2:
        channels = 1 if values.ndim == 2 else values.shape[2]
        raise RowError(
            f"{name}: expected one channel of 16 bits; found {channels} of "
            f"{values.dtype.itemsize * 8} bits"
        )
    return values.astype(np.float32)
