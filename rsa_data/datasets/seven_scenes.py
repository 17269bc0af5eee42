"""7-Scenes: Kinect video of seven rooms, or any folder of frames named as its are."""

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pyarrow as pa

from ..common.errors import RsaDataError
from ..common.ranges import Count
from .cameras import Camera, read_matrix
from .dataset import Dataset
from .depth_files import png16
from .listing import Sample, files_below, guide, lines, require_folder, to_table

# fx, fy, cx, cy in px of the depth camera, as the dataset's page gives them.
CAMERA: Camera = (585.0, 585.0, 320.0, 240.0)

_FRAME = re.compile(r"(frame-\d+)\.color\.(?:png|jpg)")


def seven_scenes(*, test_last: Count = 0) -> Dataset:
    """7-Scenes: frame-N.color.png with frame-N.depth.png in mm, 1,000 frames a sequence.

    Parameters
    ----------
    test_last : frames at the end of each sequence that are the test split, where no TrainSplit.txt
        and TestSplit.txt stand beside the sequences.
    """
    return Dataset(
        name="7scenes",
        index=partial(_index, test_last),
        # 65535 is the dataset's own mark; 0 stands in copies of it.
        read_depth=png16(1000, none=(0, 65535)),
        min_depth=1e-3,
        max_depth=10.0,
        key_paths=lambda split, key: (f"{key}.color.png", f"{key}.depth.png"),
        scene=room,
    )


def room(key: str) -> str:
    """The room of a key: all sequences of chess/ show the same one."""
    folders = [part for part in key.split("/")[:-1] if not re.fullmatch(r"seq-\d+", part)]
    return "/".join(folders) or "7scenes"


def _index(test_last: int, root: Path, split: str | None) -> pa.Table:
    require_folder("7scenes", root)
    return to_table("7scenes", root, _samples(root, test_last), split)


def _samples(root: Path, test_last: int) -> Iterator[Sample]:
    for below, names in files_below(root):
        images = {match[1]: name for name in names if (match := _FRAME.fullmatch(name))}
        if not images:
            continue
        there = set(names)
        frames = sorted(images, key=lambda frame: int(frame.removeprefix("frame-")))
        camera = _camera(root, below)
        listed = _listed_split(root / below)
        for place, frame in enumerate(frames):
            which = listed or ("test" if place >= len(frames) - test_last else "train")
            if which != "none":
                key, depth = f"{below}{frame}", f"{frame}.depth.png"
                paths = f"{below}{images[frame]}", f"{below}{depth}" if depth in there else None
                yield Sample(which, key, room(key), *paths, camera)


def _camera(root: Path, below: str) -> Camera:
    """Of camera-intrinsics.txt in the folder of the frames or one above it, else the dataset's."""
    places = [root / below, *(root / below).parents]
    for folder in places[: len(Path(below).parts) + 1]:
        path = folder / "camera-intrinsics.txt"
        if path.is_file():
            return read_matrix(path, "7scenes")
    return CAMERA


def _listed_split(sequence: Path) -> str | None:
    """train or test as the lists beside a sequence say, "none" when they leave it out.

    None when there are no lists. Their lines read `sequence1` for the folder seq-01.
    """
    lists = {"train": sequence.parent / "TrainSplit.txt", "test": sequence.parent / "TestSplit.txt"}
    match = re.fullmatch(r"seq-(\d+)", sequence.name)
    if not match or not any(path.is_file() for path in lists.values()):
        return None
    for which, path in lists.items():
        for where, fields in lines(path, "7scenes"):
            number = re.fullmatch(r"sequence(\d+)", fields[0])
            if not number or len(fields) != 1:
                raise RsaDataError(
                    f"{where}: expected a line such as sequence1, found {' '.join(fields)!r}; "
                    f"{guide('7scenes')}"
                )
            if int(number[1]) == int(match[1]):
                return which
    return "none"
