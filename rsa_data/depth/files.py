"""Relative depth that lies in files: one .npy or 16-bit PNG an image."""

import contextlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..common.errors import RowError, UsageError
from ..datasets.dataset import Dataset
from ..datasets.depth_files import read_png16
from ..datasets.images import image_size
from ..datasets.pixel_files import float32, read_npy
from ..datasets.shapes import check_aspect
from ..datasets.shards import name_of
from .model import Relative, Source


def build(*, argument: str, dataset: Dataset, root: Path, holds: str, **_: Any) -> Source:
    """Reads the relative depth of `root/IMAGE.jpg` from `argument/IMAGE.npy` or `.png`.

    argument : the folder; empty for the files that the dataset itself brings.
    holds : what the files hold, `relative` (y as it is) or `depth` (y is the inverse).
    """

    def source(image: str, folder: Path, name: str) -> Relative:
        return of_image(read(folder, str(Path(name).with_suffix("")), holds), root, image)

    if argument:
        return lambda image: source(image, Path(argument), name_of(image))
    of_dataset = dataset.relative
    if of_dataset is None:
        raise UsageError(
            f"depth model files: {dataset.name} brings no relative depth of its own; name the "
            "folder that holds it: --depth-model files:DIR"
        )
    return lambda image: source(image, root, of_dataset(name_of(image)))


def of_image(found: Relative, root: Path | None, image: str) -> Relative:
    """The relative depth of a file, with its image's size where `root / image` can be read.

    Raises RowError for a map that has not the aspect of its image.
    """
    size = None
    with contextlib.suppress(RowError):  # the maps are read also where the images are not there
        size = image_size(root / image) if root is not None else None
    if size is not None:
        check_aspect(found.y.shape, size, f"relative depth of {name_of(image)}")
    return replace(found, image=size)


def read_file(path: Path) -> Relative:
    """The relative depth of one file, .npy or .png, whatever lies beside it; see `read`."""
    return Relative(_map(path, 65535))


def read(folder: Path, stem: str, holds: str = "relative") -> Relative:
    """The relative depth `folder/stem.npy`, or `.png`, see `read_map`.

    `relative` is taken as it is, a PNG's value / 65535, so 0 to 1; `depth` is in m, a PNG's in mm,
    and y is its inverse.
    """
    values = read_map(folder, stem, 65535 if holds == "relative" else 1000)
    return Relative(values if holds == "relative" else inverse(values))


def read_map(folder: Path, stem: str, unit: float) -> np.ndarray:
    """The map `folder/stem.npy` or `folder/stem.png`; there must be one of the two.

    A .npy is a float or integer array of shape (h, w), NaN where there is nothing; a PNG has one
    channel of 16 bits, whose values are divided by `unit`. Returns float32 of shape (h, w).
    Raises RowError, naming the file relative to the folder.
    """
    array, png = folder / f"{stem}.npy", folder / f"{stem}.png"
    if array.is_file() and png.is_file():
        raise RowError(
            f"{stem}: expected one map, found {stem}.npy and {stem}.png; which of them is meant "
            "cannot be told. Move one of the two kinds to another folder"
        )
    if not (array.is_file() or png.is_file()):
        raise RowError(f"{stem}: expected a map in {stem}.npy or .png; found neither")
    return _map(array if array.is_file() else png, unit, stem)


def _map(path: Path, unit: float, stem: str = "") -> np.ndarray:
    try:
        if path.suffix == ".npy":
            return float32(read_npy(path))
        return read_png16(path).astype(np.float32) / np.float32(unit)
    except RowError as error:
        raise RowError(f"{stem or path.stem}{path.suffix}: {error}") from error


def inverse(depth: np.ndarray) -> np.ndarray:
    """1 / depth as float32; NaN where the depth is not above 0 (a dead pixel, no measurement)."""
    valid = depth > 0
    return float32(np.where(valid, 1 / np.where(valid, depth, 1), np.nan))
