"""Any folder of images, with depth of a stated unit and intrinsics where there are some."""

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
import pyarrow as pa

from ..common.errors import RowError, RsaDataError, UsageError
from ..common.numbers import reals
from ..common.ranges import Amount, PositiveAmount
from . import left_out
from .cameras import UNKNOWN, Camera, read_matrix
from .dataset import Dataset
from .depth_files import UNITS, any_file
from .held_out import held_out_last, held_out_listed
from .listing import (
    Sample,
    files_below,
    guide,
    inside,
    is_image,
    paths,
    require_folder,
    stem,
    to_table,
)
from .pairing import nearest

_SPLITS = ("train", "val", "test")
_DEPTH_SUFFIXES = (".png", ".npy")
_NUMBER = re.compile(r"\d+(?:\.\d+)?")


def folder(
    *,
    images: str | None = None,
    depth: str | None = None,
    depth_unit: str | None = None,
    depth_within: Amount | None = None,
    intrinsics: str | None = None,
    test_share: Annotated[float, msgspec.Meta(ge=0, lt=1)] = 0.0,
    test_list: Path | None = None,
    file_list: Path | None = None,
    min_depth: PositiveAmount = 1e-3,
    max_depth: PositiveAmount = 80.0,
) -> Dataset:
    """Any images below a folder; train/, val/ and test/ in it are splits when they are there.

    Parameters
    ----------
    images : name of the folders that hold images, such as rgb; without it every image is taken.
        Everything else below the root is left alone then.
    depth : name of the folders that hold depth, 16-bit PNG or .npy with the image's file name.
        It stands in the place of `images` in the path (a/rgb/1.jpg, a/depth/1.png), or before
        the whole path when `images` is not given (a/1.jpg, depth/a/1.png).
    depth_unit : unit of the depth files: m, cm, mm, or m/N for N steps a metre (m/256, m/5000).
    depth_within : pair by the numbers that the file names are, such as times, when image and depth
        have different ones: the nearest depth at most so far away; 0.02 for seconds (TUM).
    intrinsics : fx,fy,cx,cy in px of all images, or a text file below the root with the 3 x 3
        camera matrix.
    test_share : share of the images to hold out for testing, 0 to 1. Whole scenes are taken from
        the end, or the last frames where there is one scene only; not with a folder test/.
    test_list : file with the paths of the test images below the root, one a line; not with a
        folder test/.
    file_list : file with the paths of all files to take, images and depth, below the root, one a
        line; for a web server that does not list its folders, or a part of a large folder.
    min_depth : m, smaller depth counts as none.
    max_depth : m, larger depth counts as none.
    """
    if (depth is None) != (depth_unit is None):
        raise UsageError(
            "folder: depth and depth_unit go together: the name of the folders with depth, and one "
            f"of the units {', '.join(UNITS)} or m/N, N steps a metre; no unit is ever guessed"
        )
    if depth_within is not None and depth is None:
        raise UsageError("folder: depth_within goes together with depth")
    if test_share and test_list:
        raise UsageError("folder: expected test_share or test_list, found both")
    if min_depth >= max_depth:
        raise UsageError(
            f"folder: expected 0 < min_depth < max_depth, found {min_depth} and {max_depth}"
        )
    return Dataset(
        name="folder",
        index=partial(
            _index, images, depth, depth_within, intrinsics, test_share, test_list, file_list
        ),
        read_depth=any_file(depth_unit, "folder: depth_unit")
        if depth_unit is not None
        else _no_depth,
        min_depth=min_depth,
        max_depth=max_depth,
        scene=scene,
    )


def scene(key: str) -> str:
    """The folder that the image lies in."""
    return key.rpartition("/")[0] or "."


def _no_depth(path: Path) -> np.ndarray:
    raise RowError("the dataset was indexed without depth")


def _index(
    images: str | None,
    depth: str | None,
    within: float | None,
    intrinsics: str | None,
    test_share: float,
    test_list: Path | None,
    file_list: Path | None,
    root: Path,
    split: str | None,
) -> pa.Table:
    camera = _camera(root, intrinsics) if intrinsics else UNKNOWN
    if file_list:
        files = _listed_files(file_list)
    else:
        require_folder("folder", root)
        files = dict(files_below(root))
    samples = _samples(root, files, images, depth, within, camera)
    found = sorted(samples, key=lambda s: _natural(s.key))
    if depth and found and not any(s.depth for s in found):
        example = found[0].image or ""
        wanted = f"{_depth_path(stem(example), images, depth)}.png"
        raise RsaDataError(
            f"folder: {root}: expected depth such as {wanted} for the image {example}, found none "
            f"for any of {len(found)} images; {guide('folder')}"
        )
    if (test_share or test_list) and any(s.split != "train" for s in found):
        raise UsageError(
            f"folder: {root}: expected test_share or test_list, or folders train/ and test/, "
            "found both"
        )
    if test_list:
        found = held_out_listed(found, test_list, "folder")
    elif test_share:
        found = held_out_last(found, test_share)
    beside = (
        name
        for below, names in files.items()
        if _taken(below, images, depth)
        for name in names
        if not is_image(name)
    )
    return left_out.note(to_table("folder", root, found, split), beside)


def _taken(below: str, images: str | None, depth: str | None) -> bool:
    """Whether images are looked for in a folder; below : its path, with a slash at its end."""
    parts = below.split("/")[:-1]
    return depth not in parts and (images is None or images in parts)


def _samples(
    root: Path,
    files: dict[str, list[str]],
    images: str | None,
    depth: str | None,
    within: float | None,
    camera: Camera,
) -> Iterator[Sample]:
    """files : names of the files in each folder, which ends with a slash or is ""."""
    splits = {s for s in _SPLITS if any(below.startswith(f"{s}/") for below in files)}
    for below, names in files.items():
        if not _taken(below, images, depth):
            continue
        parts = below.split("/")[:-1]
        which = parts[0] if parts and parts[0] in splits else "train"
        taken = [name for name in names if is_image(name)]
        if taken and splits and parts[:1] != [which]:
            raise RsaDataError(
                f"folder: {root}: expected all images in {', '.join(sorted(splits))}, found "
                f"{below}{taken[0]}; move it, or rename the folders if they are not splits"
            )
        inner = [p for p in parts[bool(splits) :] if p != images]
        beside = _depth_path(below, images, depth) if depth else ""
        truths = _paired(taken, files.get(beside, []), within) if depth else [None] * len(taken)
        for name, truth in zip(taken, truths, strict=True):
            key = stem("/".join([*inner, name]))
            yield Sample(which, key, scene(key), below + name, truth and beside + truth, camera)


def _listed_files(listed: Path) -> dict[str, list[str]]:
    """The files of a list, as `files_below` gives those of a folder."""
    files: dict[str, list[str]] = {}
    for path in sorted({path for _, path in paths(listed, "folder")}):
        below, slash, name = path.rpartition("/")
        files.setdefault(below + slash, []).append(name)
    return files


def _paired(images: list[str], depths: list[str], within: float | None) -> list[str | None]:
    """The depth file of each image of a folder: of the same name, or of the nearest number."""
    known: dict[str, str] = {}
    for name in depths:
        if not name.lower().endswith(_DEPTH_SUFFIXES):
            continue
        if (other := known.setdefault(stem(name), name)) != name:
            raise RsaDataError(
                f"folder: expected one depth file of each image, found {other} and {name}; which "
                "of the two kinds is meant cannot be told: move one of them to a folder of its own"
            )
    if within is None:
        return [known.get(stem(name)) for name in images]
    frames = sorted((float(s), name) for s, name in known.items() if _NUMBER.fullmatch(s))
    if strange := [name for name in images if not _NUMBER.fullmatch(stem(name))]:
        raise RsaDataError(
            f"folder: expected names that are numbers, as depth_within is given; found {strange[0]}"
        )
    return nearest([float(stem(name)) for name in images], frames, within)


def _depth_path(image: str, images: str | None, depth: str) -> str:
    """Where an image's depth is looked for, below the root; the same for folders."""
    if images is None:
        return f"{depth}/{image}"
    parts = image.split("/")
    parts[parts.index(images)] = depth
    return "/".join(parts)


def _camera(root: Path, text: str) -> Camera:
    if "," not in text:
        path = root / inside(text, "folder: intrinsics")
        return read_matrix(path, "folder")
    try:
        fx, fy, cx, cy = reals(text, 4)
        if min(fx, fy) > 0 and np.isfinite((fx, fy, cx, cy)).all():
            return fx, fy, cx, cy
    except ValueError:
        pass
    raise UsageError(f"folder: intrinsics: expected fx,fy,cx,cy in px, found {text!r}")


def _natural(key: str) -> str:
    """A sort key by which frame_9 comes before frame_10: numbers by value and after all texts."""
    # One text: an index holds them all.
    return "".join(
        f"\U0010ffff{len(number := str(int(d))):04d}{number}" if d else f"{t}\0"
        for t, d in re.findall(r"(\D+)|(\d+)", key)
    )
