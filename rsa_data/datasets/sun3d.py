"""SUN3D: Xtion video of rooms, as on its site: a folder a sequence."""

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pyarrow as pa

from ..common.errors import RsaDataError
from ..common.ranges import Positive
from .cameras import UNKNOWN, read_matrix
from .dataset import Dataset
from .depth_files import png16
from .listing import (
    Sample,
    entries,
    folders_with,
    guide,
    inside,
    is_image,
    lines,
    require_folder,
    to_table,
)
from .pairing import nearest

# Microseconds from a colour frame to its depth frame: one frame at 30 Hz. The streams are not
# synchronised, and depth frames get lost.
_FRAME = 33_400

_NAME = re.compile(r"\d+-(\d+)\.\w+")


def sun3d(*, every: Positive = 1, test_list: Path | None = None) -> Dataset:
    """SUN3D: video of 415 indoor sequences; all train, but those of a list.

    Parameters
    ----------
    every : take the first of so many frames; 30 is one a second.
    test_list : file of sequences to test on, such as hotel_umd/maryland_hotel3, one a line.
    """
    return Dataset(
        name="sun3d",
        index=partial(_index, every, test_list),
        # bitshift of SUN3DreadDepth in the dataset's toolbox, mm.
        read_depth=png16(1000, rotated=3),
        min_depth=1e-3,
        max_depth=10.0,
        scene=place,
    )


def place(key: str) -> str:
    """The place of a key, PLACE/SEQUENCE/FRAME; several sequences show one."""
    return key.split("/")[0]


def _index(every: int, test_list: Path | None, root: Path, split: str | None) -> pa.Table:
    require_folder("sun3d", root)
    return to_table("sun3d", root, _samples(root, every, test_list), split)


def _samples(root: Path, every: int, test_list: Path | None) -> Iterator[Sample]:
    sequences = list(folders_with(root, "image", "depth"))
    test = set()
    for where, fields in lines(test_list, "sun3d") if test_list else ():
        sequence = inside(" ".join(fields), where)
        if sequence not in sequences:
            raise RsaDataError(
                f"{where}: expected a sequence below {root}, found {sequence!r}; {guide('sun3d')}"
            )
        test.add(sequence)
    for sequence in sequences:
        split = "test" if sequence in test else "train"
        matrix = root / sequence / "intrinsics.txt"
        camera = read_matrix(matrix, "sun3d") if matrix.is_file() else UNKNOWN
        for image, depth in _pairs(root / sequence, every):
            key = f"{sequence}/{image.rpartition('.')[0]}"
            paths = f"{sequence}/image/{image}", depth and f"{sequence}/depth/{depth}"
            yield Sample(split, key, place(key), *paths, camera)


def _pairs(sequence: Path, every: int) -> Iterator[tuple[str, str | None]]:
    """Each colour frame with the depth frame nearest in time, as the dataset's toolbox pairs them.

    Names are NUMBER-TIME, time in microseconds. Without a depth frame within one frame: None.
    """
    images = _timed(sequence / "image")[::every]
    depths = nearest([time for time, _ in images], _timed(sequence / "depth"), _FRAME)
    yield from zip((name for _, name in images), depths, strict=True)


def _timed(folder: Path) -> list[tuple[int, str]]:
    """(time, name) of each frame, in the order of time."""
    names = [name for name in entries(folder)[0] if is_image(name)]
    return sorted((int(match[1]), name) for name in names if (match := _NAME.fullmatch(name)))
