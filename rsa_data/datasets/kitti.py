"""KITTI: raw images and the depth benchmark's ground truth, split as BTS and RSA do (Eigen)."""

from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from ..common import bounded
from ..common.errors import RsaDataError
from . import bts
from .dataset import Dataset
from .depth_files import png16
from .listing import Sample, entries, guide, require_folder, stem, to_table

_LISTS = {"train": "eigen_train_files_with_gt.txt", "test": "eigen_test_files_with_gt.txt"}

# Below the root: where dates (2011_09_26, ...) and where drives with proj_depth may lie. The first
# of each is BTS's; the archive of the ground truth unpacks to train/ and val/; RSA's are last.
_RAW = (".", "raw", "kitti_raw_data")
_DEPTH = (
    "data_depth_annotated",
    "data_depth_annotated/train",
    "data_depth_annotated/val",
    "train",
    "val",
    "kitti_ground_truth",
)

# Height and width, px, of the benchmark's own images, to which BTS (`do_kb_crop`) and RSA crop:
# bottom, centred.
CROP = (352, 1216)


def kitti(*, train_list: Path | None = None, test_list: Path | None = None) -> Dataset:
    """KITTI: streets, 23,158 training and 652 test images in RSA's lists of the Eigen split.

    Parameters
    ----------
    train_list : file of lines `image depth focal` for training; else the one of BTS below the root.
    test_list : the same for testing.
    """
    return Dataset(
        name="kitti",
        index=partial(_index, {"train": train_list, "test": test_list}),
        read_depth=png16(256),
        min_depth=1e-3,
        max_depth=80.0,
        train_mask=crop,
        key_paths=lambda split, key: (f"{key}.png", f"{_DEPTH[0]}/{_depth_of(key)}"),
        scene=drive,
    )


def drive(key: str) -> str:
    """The drive of a key, which is one ride: neighbouring images are nearly equal."""
    parts = key.split("/")
    return parts[1] if len(parts) > 1 else parts[0]


def crop(height: int, width: int) -> np.ndarray:
    """bool of shape (height, width): True inside the crop to 352 x 1216, bottom, centred."""
    mask = np.zeros((height, width), bool)
    left = max(0, (width - CROP[1]) // 2)
    mask[max(0, height - CROP[0]) :, left : left + CROP[1]] = True
    return mask


def _depth_of(key: str) -> str:
    """DRIVE/proj_depth/groundtruth/image_02/N.png of DATE/DRIVE/image_02/data/N."""
    parts = key.split("/")
    return f"{drive(key)}/proj_depth/groundtruth/{'/'.join(parts[2:-2])}/{parts[-1]}.png"


def _index(given: dict[str, Path | None], root: Path, split: str | None) -> pa.Table:
    require_folder("kitti", root)
    raw = next((r for r in _RAW if any((root / r).glob("20??_??_??"))), None)
    if raw is None:
        raise RsaDataError(
            f"kitti: {root}: expected folders of dates such as 2011_09_26 in it, in raw/ or in "
            f"kitti_raw_data/, found none; {guide('kitti')}"
        )
    lists = {s: bts.find(root, name, given[s]) for s, name in _LISTS.items() if split in (None, s)}
    if not any(lists.values()):
        names = " or ".join(_LISTS[s] for s in lists)
        raise RsaDataError(
            f"kitti: {root}: expected the split file {names}, found none. KITTI's own layout does "
            f"not tell the Eigen split; {guide('kitti')}"
        )
    drives = {
        name: place
        for place in reversed(_DEPTH)
        if (root / place).is_dir()
        for name in entries(root / place)[1]
    }
    prefix = "" if raw == "." else f"{raw}/"
    found = (
        s
        for which, path in lists.items()
        if path
        for s in _split(root, prefix, drives, which, path)
    )
    return to_table("kitti", root, found, split)


def _split(
    root: Path, prefix: str, drives: dict[str, str], split: str, listed: Path
) -> Iterator[Sample]:
    @cache
    def camera(date: str, number: str) -> tuple[float, float, float, float] | None:
        path = root / prefix / date / "calib_cam_to_cam.txt"
        return read_camera(path, number) if path.is_file() else None

    for image, depth, focal in bts.read(listed, "kitti"):
        key = stem(image)
        if depth is not None:
            depth = f"{drives.get(depth.split('/')[0], _DEPTH[0])}/{depth}"
        date, number = key.split("/")[0], "03" if "/image_03/" in key else "02"
        known = camera(date, number) or (focal, focal, None, None)
        yield Sample(split, key, drive(key), f"{prefix}{image}", depth, known)


def read_camera(path: Path, number: str) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy in px of a rectified camera ("02": left, colour) of calib_cam_to_cam.txt.

    The line is P_rect_NN, a 3 x 4 matrix row by row. Raises RsaDataError when it is not there.
    """
    start = f"P_rect_{number}:"
    text = bounded.read(path, "text").decode("utf-8", "replace")
    for line in text.splitlines():
        if line.startswith(start):
            try:
                p = [float(v) for v in line[len(start) :].split()]
            except ValueError:
                break
            if len(p) == 12:
                return p[0], p[5], p[2], p[6]
    raise RsaDataError(f"kitti: {path}: expected a line {start} with 12 numbers, found none")
