"""VOID: video of rooms and stairs with the depth of an Intel RealSense, lists of paths."""

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pyarrow as pa

from ..common.errors import RsaDataError
from .cameras import UNKNOWN, Camera, read_matrix
from .dataset import Dataset
from .depth_files import png16
from .listing import Sample, guide, inside, lines, require_folder, stem, to_table

# The folder of the release with 1,500 sparse points; images and ground truth are in all the same.
_FOLDER = "void_1500"


def void() -> Dataset:
    """VOID 1500: indoor and outdoor, 48,248 training and 800 test images."""
    return Dataset(
        name="void",
        index=_index,
        read_depth=png16(256),
        min_depth=0.2,
        max_depth=5.0,
        key_paths=lambda split, key: (
            f"{key}.png",
            f"{key.replace('/image/', '/ground_truth/')}.png",
        ),
        scene=place,
    )


def place(key: str) -> str:
    """The place of a key: sequences copyroom0 and copyroom1 were recorded in one."""
    parts = key.split("/")
    sequence = parts[-3] if len(parts) >= 3 else parts[0]
    return re.sub(r"\d+$", "", sequence) or sequence


def _index(root: Path, split: str | None) -> pa.Table:
    require_folder("void", root, _FOLDER)
    wanted = [s for s in ("train", "test") if split in (None, s)]
    found = (s for which in wanted for s in _split(root, which))
    return to_table("void", root, found, split)


def _split(root: Path, split: str) -> Iterator[Sample]:
    """Samples of the lists SPLIT_image.txt and SPLIT_ground_truth.txt; K.txt lies by the images."""
    images = _paths(root, split, "image")
    depths = _paths(root, split, "ground_truth")
    if len(images) != len(depths):
        raise RsaDataError(
            f"void: {root / _FOLDER}: expected as many lines in {split}_ground_truth.txt as in "
            f"{split}_image.txt ({len(images)}), found {len(depths)}; get the lists again, "
            f"{guide('void')}"
        )

    @cache
    def camera(sequence: Path) -> Camera:
        path = sequence / "K.txt"
        return read_matrix(path, "void") if path.is_file() else UNKNOWN

    for image, depth in zip(images, depths, strict=True):
        key = stem(image)
        yield Sample(split, key, place(key), image, depth, camera((root / image).parents[1]))


def _paths(root: Path, split: str, what: str) -> list[str]:
    return [
        inside(" ".join(fields), where)
        for where, fields in lines(root / _FOLDER / f"{split}_{what}.txt", "void")
    ]
