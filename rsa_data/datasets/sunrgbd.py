"""SUN RGB-D: single indoor frames of four depth cameras; the test set of zero-shot tables."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Literal

import pyarrow as pa

from ..common.errors import RsaDataError
from .cameras import UNKNOWN, read_matrix
from .dataset import Dataset
from .depth_files import png16
from .listing import Sample, entries, folders_with, guide, inside, lines, require_folder, to_table

# 5,050 lines `image depth`: Monocular-Depth-Estimation-Toolbox, splits/; it equals the official
# test split of SUNRGBDtoolbox, in text.
_LIST = "SUNRGBD_val_splits.txt"


def sunrgbd(
    *, depth: Literal["depth", "depth_bfx"] = "depth", test_list: Path | None = None
) -> Dataset:
    """SUN RGB-D: indoor, 5,285 training and 5,050 test images.

    Parameters
    ----------
    depth : the sensor's depth, or depth_bfx, where holes are filled by the dataset's authors.
    test_list : file of lines `image depth`, paths from SUNRGBD/ on; else the toolbox's below root.
    """
    return Dataset(
        name="sunrgbd",
        index=partial(_index, depth, test_list),
        # bitshift of read3dPoints.m in SUNRGBDtoolbox, mm; farther than 8 m is cut there, too.
        read_depth=png16(1000, rotated=3),
        min_depth=1e-3,
        max_depth=8.0,
        scene=scene,
    )


def scene(key: str) -> str:
    """What must not be divided: a SUN3D video, all NYU frames (their rooms are not told), a frame.

    kv1/NYUdata/NYU0001 -> kv1/NYUdata; xtion/sun3ddata/mit_32_d507/d507_1/0000008-000000234612 ->
    xtion/sun3ddata/mit_32_d507, as several videos show one place.
    """
    parts = key.split("/")
    if parts[1:2] == ["NYUdata"]:
        return "/".join(parts[:2])
    return "/".join(parts[:3])


def _index(depth: str, test_list: Path | None, root: Path, split: str | None) -> pa.Table:
    require_folder("sunrgbd", root, "SUNRGBD")
    listed = test_list or root / _LIST
    if not listed.is_file():
        raise RsaDataError(
            f"sunrgbd: expected the test list {listed}, found nothing there; {guide('sunrgbd')}"
        )
    return to_table("sunrgbd", root, _samples(root, depth, listed), split)


def _samples(root: Path, depth: str, listed: Path) -> Iterator[Sample]:
    test = dict(_listed(listed))
    for key in folders_with(root / "SUNRGBD", "image", depth):
        split = "test" if test.pop(key, None) else "train"
        folder = root / "SUNRGBD" / key
        image, truth = _only_file(folder / "image"), _only_file(folder / depth)
        matrix = folder / "intrinsics.txt"
        camera = read_matrix(matrix, "sunrgbd") if matrix.is_file() else UNKNOWN
        paths = f"SUNRGBD/{key}/image/{image}", f"SUNRGBD/{key}/{depth}/{truth}"
        yield Sample(split, key, scene(key), *paths, camera)
    for key, image in test.items():  # listed and not on disk: to fail by name, not to be forgotten
        yield Sample("test", key, scene(key), image, None)


def _only_file(folder: Path) -> str:
    names = entries(folder)[0]
    if len(names) != 1:
        raise RsaDataError(
            f"sunrgbd: {folder}: expected one file, found {len(names)}; unpack SUNRGBD.zip again"
        )
    return names[0]


def _listed(path: Path) -> Iterator[tuple[str, str]]:
    """(key, image) of each line; the key is the frame's folder below SUNRGBD/."""
    for where, fields in lines(path, "sunrgbd"):
        image = inside(fields[0], where)
        parts = PurePosixPath(image).parts
        if parts[0] != "SUNRGBD" or len(parts) < 5 or parts[-2] != "image" or len(fields) != 2:
            raise RsaDataError(
                f"{where}: expected `SUNRGBD/.../image/NAME.jpg SUNRGBD/.../depth/NAME.png`, found "
                f"{' '.join(fields)!r}; {guide('sunrgbd')}"
            )
        yield "/".join(parts[1:-2]), image
