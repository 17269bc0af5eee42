"""DDAD: streets with six cameras and long-range LiDAR, in TRI's DGP format."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from ..common import bounded
from ..common.errors import RowError, RsaDataError
from .dataset import Dataset
from .dgp import project, read_points, read_scene
from .listing import Sample, guide, inside, require_folder, stem, to_table

# Splits of ddad.json by their number: dgp/proto/dataset.proto (DatasetSplit).
_SPLITS = {"0": "train", "1": "val", "2": "test"}


def ddad(*, cameras: str = "CAMERA_01") -> Dataset:
    """DDAD: streets, 150 training and 50 validation scenes; val is the one that tables report.

    Parameters
    ----------
    cameras : names with commas between them; CAMERA_01 is the front one, 05 to 09 look around.
    """
    return Dataset(
        name="ddad",
        index=partial(_index, [c.strip() for c in cameras.split(",")]),
        read_depth=read_depth,
        min_depth=1e-3,
        max_depth=80.0,
        scene=lambda key: key.split("/")[0],
        test_splits=("val", "test"),
    )


def read_depth(path: Path) -> np.ndarray:
    """The LiDAR sweep projected into a camera, float32 of shape (height, width), m.

    path : SCENE/point_cloud/LIDAR/TIME.npz#CAMERA, since one sweep serves all cameras.
    """
    name, _, camera = path.name.partition("#")
    folder, lidar = path.parents[2], f"{path.parents[1].name}/{path.parent.name}/{name}"
    for scene in sorted(folder.glob("scene_*.json")):
        for view in read_scene(scene):
            if (view.lidar, view.camera) == (lidar, camera):
                return project(read_points(path.with_name(name)), view)
    raise RowError(f"depth: expected {camera} with {lidar} in scene_*.json, found none")


def _index(cameras: list[str], root: Path, split: str | None) -> pa.Table:
    require_folder("ddad", root)
    samples = list(_samples(root, cameras))
    return to_table("ddad", root, samples, split)


def _samples(root: Path, cameras: list[str]) -> Iterator[Sample]:
    known: set[str] = set()
    for split, scene in _scenes(root):
        folder = scene.parent.relative_to(root).as_posix()
        for view in read_scene(scene):
            known.add(view.camera)
            if view.camera in cameras:
                image = f"{folder}/{view.image}"
                depth = f"{folder}/{view.lidar}#{view.camera}" if view.lidar else None
                key = f"{folder}/{view.camera}/{Path(stem(view.image)).name}"
                camera, size = view.intrinsics[:4], (view.width, view.height)
                yield Sample(split, key, folder, image, depth, camera, size)
    if known and (strange := set(cameras) - known):
        raise RsaDataError(
            f"ddad: {root}: expected cameras among {', '.join(sorted(known))}, found "
            f"{', '.join(sorted(strange))}"
        )


def _scenes(root: Path) -> Iterator[tuple[str, Path]]:
    """(split, scene JSON): those that ddad.json names, or without it every scene as train."""
    listing = root / "ddad.json"
    if not listing.is_file():
        yield from (("train", path) for path in sorted(root.glob("*/scene_*.json")))
        return
    try:
        splits = bounded.read_json(listing)["scene_splits"]
        named = [
            (_SPLITS[number], name)
            for number in sorted(splits)
            if number in _SPLITS
            for name in splits[number]["filenames"]
        ]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RsaDataError(
            f"ddad: {listing}: expected scene_splits with filenames, found {error!r}; "
            f"{guide('ddad')}"
        ) from error
    for split, name in named:
        yield split, root / inside(str(name), f"ddad: {listing}")
