"""Rendered scenes on disk: images, depth, relative depth, and COCO panoptic segments.

ROOT/recipe.json                what the scenes were made from
ROOT/SPLIT/rgb/KEY.png          8-bit RGB
ROOT/SPLIT/depth/KEY.png        16-bit metric depth, 0 = none
ROOT/SPLIT/relative/KEY.npy     float16 relative depth
ROOT/SPLIT/panoptic/KEY.png     COCO panoptic ids as colours
ROOT/SPLIT/records/KEY.json     the image's entry of panoptic.json, written last
ROOT/panoptic.json              COCO panoptic annotations of all splits, written last
"""

import io
import json
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from tqdm import tqdm

from ...common import files
from ...common.errors import RsaDataError
from .builder import categories
from .scenes import Shot, World, shoot

# Units of the 16-bit depth in a metre: NYUv2's and KITTI's.
INDOOR_UNITS, STREET_UNITS = 1000, 256
PANOPTIC = "panoptic.json"
VIEWS = 2
# Bumped when the same recipe gives other pictures.
VERSION = 1


@dataclass(frozen=True)
class Recipe:
    """What decides every byte: name of the dataset, scenes of each split, seed."""

    name: str
    scenes: int
    test_scenes: int
    seed: int
    version: int = VERSION

    def images(self) -> Iterator[tuple[str, int, int, list[str]]]:
        """(split, number of the split, number of the scene, keys of its images)."""
        for place, (split, count) in enumerate(
            (("train", self.scenes), ("test", self.test_scenes))
        ):
            for number in range(count):
                yield split, place, number, [f"{number:05d}_{view}" for view in range(VIEWS)]


def relative_path(image: str) -> str:
    """Where the relative depth of an image lies, both relative to the root."""
    path = PurePosixPath(image)
    return str(path.parent.parent / "relative" / f"{path.stem}.npy")


def complete(root: Path, recipe: Recipe) -> bool:
    """Whether everything of this recipe is written."""
    return (root / PANOPTIC).is_file() and _written_recipe(root) == asdict(recipe)


def write(root: Path, recipe: Recipe, world: World, units: int) -> None:
    """Renders what is missing below `root`; killed half-way, the next call goes on from there.

    Raises RsaDataError when root holds scenes of another recipe, or cannot be written.
    """
    if complete(root, recipe):
        return
    try:
        _claim(root, recipe)
        todo = [
            scene
            for scene in recipe.images()
            if not all((root / scene[0] / "records" / f"{key}.json").is_file() for key in scene[3])
        ]
        # A scene follows from its numbers alone, so they may be made side by side.
        one = partial(_write_scene, root, recipe.seed, world, units)
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            done = pool.map(one, todo)
            about: dict[str, Any] = {"unit": " scenes", "leave": False, "disable": None}
            for _ in tqdm(done, f"{recipe.name} render", len(todo), **about):
                pass
        files.write(root / PANOPTIC, _panoptic(root, recipe))
    except OSError as error:
        raise RsaDataError(
            f"{recipe.name}: {root}: expected to write rendered scenes there; {error.strerror}. "
            "Make room, or give another place with --root"
        ) from error


def read_records(root: Path) -> list[dict[str, Any]]:
    """One record an image, of panoptic.json: split, key, width, height, camera."""
    records: list[dict[str, Any]] = json.loads((root / PANOPTIC).read_text("utf-8"))["images"]
    return records


def _claim(root: Path, recipe: Recipe) -> None:
    """Leaves the recipe in an empty root; refuses a root that something else lies in."""
    root.mkdir(parents=True, exist_ok=True)
    found = _written_recipe(root)
    if found is None and any(not p.name.startswith(".") for p in root.iterdir()):
        raise RsaDataError(
            f"{recipe.name}: {root}: expected an empty folder or one with its recipe.json, found "
            "other files; give another --root"
        )
    if found is None:
        files.write(root / "recipe.json", json.dumps(asdict(recipe), indent=1).encode())
    elif found != asdict(recipe):
        wanted = asdict(recipe)
        differ = [f"{k} = {found.get(k)}" for k in wanted if found.get(k) != wanted[k]]
        asked = [str(wanted[k]) for k in wanted if found.get(k) != wanted[k]]
        raise RsaDataError(
            f"{recipe.name}: {root}: holds scenes rendered with {', '.join(differ)}, not "
            f"{', '.join(asked)}; give another --root, or delete that folder"
        )


def _written_recipe(root: Path) -> dict[str, Any] | None:
    path = root / "recipe.json"
    try:
        recipe: dict[str, Any] = json.loads(path.read_text("utf-8"))
        return recipe
    except FileNotFoundError:
        return None
    except ValueError as error:
        raise RsaDataError(
            f"{path}: expected JSON, found: {error}; delete the folder {root} to render it anew"
        ) from error


def _write_scene(
    root: Path, seed: int, world: World, units: int, scene: tuple[str, int, int, list[str]]
) -> None:
    split, place, number, keys = scene
    shots = shoot(world, (seed, place, number), len(keys))
    for key, shot in zip(keys, shots, strict=True):
        _write_shot(root, split, key, shot, units)


def _write_shot(root: Path, split: str, key: str, shot: Shot, units: int) -> None:
    height, width = shot.segments.shape
    metric = np.where(np.isfinite(shot.depth), shot.depth, 0) * units
    metric = np.where(metric > 65535, 0, metric)
    files.write(root / split / "rgb" / f"{key}.png", _png(shot.image[:, :, ::-1]))
    files.write(root / split / "depth" / f"{key}.png", _png((metric + 0.5).astype(np.uint16)))
    relative = io.BytesIO()
    np.save(relative, shot.relative.astype("<f2"))
    files.write(root / split / "relative" / f"{key}.npy", relative.getvalue())
    # Ids spread over the colours, so that the map can be looked at; 0 stays nothing.
    ids = np.array([0, *(_id(k) for k in range(len(shot.labels)))])
    colours = np.stack([ids >> 16, ids >> 8 & 255, ids & 255], -1).astype(np.uint8)  # B, G, R
    files.write(root / split / "panoptic" / f"{key}.png", _png(colours.take(shot.segments, 0)))
    pixels = np.bincount(shot.segments.ravel(), minlength=len(shot.labels) + 1)[1:]
    focal = shot.camera.focal
    record = {
        "image": {
            "file_name": f"{split}/rgb/{key}.png",
            "split": split,
            "key": key,
            "width": width,
            "height": height,
            "camera": {"fx": focal, "fy": focal, "cx": width / 2, "cy": height / 2},
        },
        "annotation": {
            "file_name": f"{split}/panoptic/{key}.png",
            "segments_info": [
                {"id": _id(k), "category_id": categories()[label].id, "area": int(n), "iscrowd": 0}
                for k, (label, n) in enumerate(zip(shot.labels, pixels, strict=True))
            ],
        },
    }
    files.write(root / split / "records" / f"{key}.json", json.dumps(record).encode())


def _id(place: int) -> int:
    """An id of 1 to 2^24 - 1 for the segment at a place: 1 + place times an odd number."""
    return (1 + place * 0x3A6F51) % (1 << 24) or 1


def _panoptic(root: Path, recipe: Recipe) -> bytes:
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    used: set[int] = set()
    for split, _, _, keys in recipe.images():
        for key in keys:
            record = json.loads((root / split / "records" / f"{key}.json").read_text("utf-8"))
            images.append({"id": len(images) + 1, **record["image"]})
            annotations.append({"image_id": len(images), **record["annotation"]})
            used |= {s["category_id"] for s in record["annotation"]["segments_info"]}
    classes = [
        {"id": c.id, "name": name, "isthing": int(c.thing)}
        for name, c in sorted(categories().items(), key=lambda item: item[1].id)
        if c.id in used
    ]
    info = {"description": f"{recipe.name}: rendered, not photographed", **asdict(recipe)}
    content = {"info": info, "images": images, "annotations": annotations, "categories": classes}
    return json.dumps(content).encode()


def _png(pixels: np.ndarray) -> bytes:
    """PNG of grey or of B, G, R."""
    import cv2

    return cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
