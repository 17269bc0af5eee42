"""Synthetic rooms and streets: rendered on first use, then read from files as any dataset is."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pyarrow as pa

from ...common.errors import RsaDataError
from ...common.ranges import Count, Positive
from ..dataset import Dataset
from ..depth_files import png16
from ..listing import Sample, to_table
from . import files
from .files import Recipe
from .scenes import INDOOR, STREET


def synthetic_indoor(
    *, scenes: Positive = 160, test_scenes: Count = 40, seed: Count = 0
) -> Dataset:
    """Rendered rooms from a bathroom to a sports hall, with true metric sizes; made on first use.

    Parameters
    ----------
    scenes : rooms of the training split, two images each.
    test_scenes : rooms of the test split, two images each.
    seed : another one gives other rooms.
    """
    recipe = _recipe("synthetic-indoor", scenes, test_scenes, seed)
    return Dataset(
        name=recipe.name,
        index=partial(_index, recipe),
        # Up to 65 m: the largest hall has 48 m from corner to corner.
        read_depth=png16(files.INDOOR_UNITS),
        min_depth=1e-3,
        max_depth=50.0,
        key_paths=_paths,
        scene=lambda key: key.split("_")[0],
        relative=files.relative_path,
        panoptic=files.PANOPTIC,
        prepare=lambda root: files.write(root, recipe, INDOOR, files.INDOOR_UNITS),
    )


def synthetic_street(
    *, scenes: Positive = 160, test_scenes: Count = 40, seed: Count = 0
) -> Dataset:
    """Rendered streets from an alley to a highway, with true metric sizes; made on first use.

    Parameters
    ----------
    scenes : streets of the training split, two images each.
    test_scenes : streets of the test split, two images each.
    seed : another one gives other streets.
    """
    recipe = _recipe("synthetic-street", scenes, test_scenes, seed)
    return Dataset(
        name=recipe.name,
        index=partial(_index, recipe),
        read_depth=png16(files.STREET_UNITS),
        min_depth=1e-3,
        # As for KITTI; the files hold up to 255 m.
        max_depth=80.0,
        key_paths=_paths,
        scene=lambda key: key.split("_")[0],
        relative=files.relative_path,
        panoptic=files.PANOPTIC,
        prepare=lambda root: files.write(root, recipe, STREET, files.STREET_UNITS),
    )


def _recipe(name: str, scenes: int, test_scenes: int, seed: int) -> Recipe:
    return Recipe(name, scenes, test_scenes, seed)


def _paths(split: str, key: str) -> tuple[str | None, str | None]:
    return f"{split}/rgb/{key}.png", f"{split}/depth/{key}.png"


def _index(recipe: Recipe, root: Path, split: str | None) -> pa.Table:
    if not files.complete(root, recipe):
        raise RsaDataError(
            f"{recipe.name}: {root}: expected rendered scenes, found none or some only; "
            f"`rsa-data captions --dataset {recipe.name}` renders them"
        )
    return to_table(recipe.name, root, _samples(root), split)


def _samples(root: Path) -> Iterator[Sample]:
    for record in files.read_records(root):
        camera = record["camera"]
        yield Sample(
            record["split"],
            record["key"],
            record["key"].split("_")[0],
            *_paths(record["split"], record["key"]),
            (camera["fx"], camera["fy"], camera["cx"], camera["cy"]),
            (record["width"], record["height"]),
        )
