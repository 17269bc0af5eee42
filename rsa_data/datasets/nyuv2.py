"""NYU Depth v2 as BTS and RSA lay it out: sync/ to train, official_splits/test/ to test."""

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from . import bts
from .dataset import Dataset
from .depth_files import png16
from .listing import Sample, files_below, require_folder, stem, to_table

# fx, fy, cx, cy in px of the colour camera: camera_params.m of the dataset's own toolbox.
CAMERA = (518.85790117450188, 519.46961112127485, 325.58244941119034, 253.73616633400465)

# Rows and columns of the 480 x 640 frame that have ground truth: dataloader.py of BTS and RSA.
_ROWS, _COLUMNS = (45, 472), (43, 608)

_FOLDERS = {"train": "sync", "test": "official_splits/test"}
_LISTS = {
    "train": "nyudepthv2_train_files_with_gt.txt",
    "test": "nyudepthv2_test_files_with_gt.txt",
}


def nyuv2(*, train_list: Path | None = None, test_list: Path | None = None) -> Dataset:
    """NYU Depth v2: indoor, 24,231 training and 654 test images in the lists of BTS and RSA.

    Parameters
    ----------
    train_list : file of lines `image depth focal` for training; else the one of BTS below the
        root, else every image of sync/ that has a depth beside it.
    test_list : the same for testing, below official_splits/test/.
    """
    return Dataset(
        name="nyuv2",
        index=partial(_index, {"train": train_list, "test": test_list}),
        read_depth=png16(1000),
        min_depth=1e-3,
        max_depth=10.0,
        train_mask=border,
        key_paths=_paths,
        scene=room,
    )


def room(key: str) -> str:
    """The room of a key: bedroom_0001a and bedroom_0001b are recordings of bedroom_0001.

    Test images come with the type of room only.
    """
    return re.sub(r"(_\d{4})[a-z]$", r"\1", key.split("/")[0])


def border(height: int, width: int) -> np.ndarray:
    """bool of shape (height, width): True inside the border without ground truth."""
    mask = np.zeros((height, width), bool)
    rows = slice(*(round(r * height / 480) for r in _ROWS))
    columns = slice(*(round(c * width / 640) for c in _COLUMNS))
    mask[rows, columns] = True
    return mask


def _paths(split: str, key: str) -> tuple[str | None, str | None]:
    if split not in _FOLDERS:
        return None, None
    folder = _FOLDERS[split]
    return f"{folder}/{key}.jpg", f"{folder}/{_depth_of(key)}.png"


def _depth_of(key: str) -> str:
    return re.sub(r"(^|/)rgb_([^/]*)$", r"\1sync_depth_\2", key)


def _index(given: dict[str, Path | None], root: Path, split: str | None) -> pa.Table:
    require_folder("nyuv2", root, *([_FOLDERS[split]] if split in _FOLDERS else _FOLDERS.values()))
    found = (s for which in _FOLDERS if split in (None, which) for s in _split(root, which, given))
    return to_table("nyuv2", root, found, split)


def _split(root: Path, split: str, given: dict[str, Path | None]) -> Iterator[Sample]:
    folder = _FOLDERS[split]
    if not (root / folder).is_dir():
        return
    if (listed := bts.find(root, _LISTS[split], given[split])) is not None:
        pairs = [(image, depth) for image, depth, _ in bts.read(listed, "nyuv2")]
    else:
        pairs = list(_pairs(root / folder))
    for image, depth in pairs:
        key = stem(image)
        paths = f"{folder}/{image}", depth and f"{folder}/{depth}"
        yield Sample(split, key, room(key), *paths, CAMERA)


def _pairs(folder: Path) -> Iterator[tuple[str, str | None]]:
    """Images that have a depth beside them, without reading a split file."""
    for below, names in files_below(folder):
        there = set(names)
        for name in names:
            if name.startswith("rgb_") and name.endswith(".jpg"):
                depth = f"{_depth_of(stem(name))}.png"
                if depth in there:
                    yield f"{below}{name}", f"{below}{depth}"
