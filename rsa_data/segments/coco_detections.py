"""Segments of COCO detection results or instance annotations: boxes, polygons or run lengths."""

import json
import re
import threading
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pyarrow as pa

from ..common import class_names
from ..common.class_names import ClassTable
from ..common.errors import RowError, RsaDataError, UsageError
from ..common.extras import extras
from ..common.prefetch import each
from ..datasets import images
from ..datasets.dataset import Dataset
from ..datasets.roots import readers
from . import coco_json, masks
from .coco_panoptic import ByFileName, categories
from .found import Found, to_segments
from .segments import Segments, to_table

_WHERE = "segments/coco-detections"
_ALONE = threading.Lock()


def build(
    *,
    argument: str | None,
    dataset: Dataset,
    root: Path | None,
    names: str | None = None,
    score_threshold: float | None = None,
    masks: bool = False,
    **_: Any,
) -> Callable[[pa.Table], pa.Table]:
    """coco-detections:JSON[:IMAGES]: COCO detection results or instance annotations.

    argument : JSON, or JSON:IMAGES where IMAGES is an annotation file with the images' names and
        sizes. Without one, a result belongs to the image whose file name ends in its image_id.
    names : class table of the category ids, where the files name none; COCO's own otherwise.
    """
    results, image_list, table = _read(argument, names)
    by_name = ByFileName(image_list, _file_names(argument)[-1].name) if image_list else None
    by_image: dict[Any, list[dict[str, Any]]] = {}
    for result in results:
        if result.get("score", 1.0) >= (score_threshold or 0.0):
            by_image.setdefault(_key(result["image_id"]), []).append(result)

    def one(sample: dict[str, Any]) -> Segments:
        image = sample["image"]
        record: dict[str, Any] = by_name.find(image) if by_name else {"id": image_id(image)}
        width, height = _size(record, sample, root)
        try:
            return segments(by_image.get(_key(record["id"]), []), width, height, table, masks)
        except RowError as error:
            raise RowError(f"{_WHERE}: image {record['id']}: {error}") from error

    def step(samples: pa.Table) -> pa.Table:
        rows = samples.select(["image", "width", "height"]).to_pylist()
        return to_table(samples["sample_id"].to_pylist(), each(one, rows, readers(root)))

    return step


def files(*, argument: str | None, names: str | None = None, **_: Any) -> dict[str, Path]:
    """The JSON files, and the file of names where they come from one."""
    found = dict(zip(("results", "images"), _file_names(argument), strict=False))
    return found | ({"names": Path(names)} if names and Path(names).is_file() else {})


def segments(
    results: Iterable[dict[str, Any]],
    width: int,
    height: int,
    table: ClassTable,
    with_masks: bool = False,
) -> Segments:
    """Segments of one image, best first; shares are of the masks where there are any.

    results : bbox (x, y, w, h, px) or segmentation (RLE or polygons), category_id, score.
    Raises RowError when a result has neither, or a mask of another size than the image.
    """
    ordered = sorted(results, key=lambda result: -result.get("score", 1.0))
    number = np.array([result["category_id"] for result in ordered], np.int64)
    score = np.array([result.get("score", 1.0) for result in ordered], np.float32)
    if any(result.get("segmentation") for result in ordered):
        decoded = [_mask(result, width, height) for result in ordered]
        return to_segments(
            Found(number, score, masks=decoded), width, height, table, with_masks=with_masks
        )
    if missing := [result for result in ordered if len(result.get("bbox", ())) != 4]:
        raise RowError(f"expected bbox = [x, y, w, h] or a segmentation, found {missing[0]}")
    box = np.array([result["bbox"] for result in ordered], np.float64).reshape(-1, 4)
    box[:, 2:] += box[:, :2]
    return to_segments(Found(number, score, box), width, height, table)


def _mask(result: dict[str, Any], width: int, height: int) -> np.ndarray:
    """The mask of one result, bool (height, width)."""
    with extras("segmentations"):
        from pycocotools import mask as coco_mask
    given = result.get("segmentation")
    try:
        if isinstance(given, list) and given:
            _check_polygons(given, height, width)
            given = coco_mask.merge(coco_mask.frPyObjects(given, height, width))
        elif isinstance(given, dict) and isinstance(given.get("counts"), list):
            given = coco_mask.frPyObjects(given, *given["size"])
        if not isinstance(given, dict):
            raise RowError(f"expected a segmentation for every result or for none, found {given!r}")
        if list(given["size"]) != [height, width]:
            raise RowError(f"mask of size {given['size']}: expected the image's {[height, width]}")
        if masks.covered(given["counts"]) != height * width:
            # pycocotools would leave the rest as whatever memory held.
            raise RowError(f"run lengths: expected {height * width} pixels in all, found others")
        # What catch_warnings changes is the whole process's.
        with _ALONE, warnings.catch_warnings():
            # pycocotools' arrays do not know numpy 2's copy argument yet.
            warnings.simplefilter("ignore", DeprecationWarning)
            mask: np.ndarray = coco_mask.decode(given).astype(bool)
            return mask
    except RowError:
        raise
    except Exception as error:  # pycocotools raises nearly every built-in kind
        raise RowError(f"expected a segmentation as RLE or polygons: {error}") from error


def _check_polygons(polygons: list[Any], height: int, width: int) -> None:
    """Points far outside would take memory by their distance."""
    points = np.concatenate([np.asarray(polygon, np.float64).ravel() for polygon in polygons])
    most = 2 * max(height, width)
    if not (np.abs(points) <= most).all():
        raise RowError(f"polygon: expected points in the image, found one beyond {most} px")


def image_id(image: str | None) -> int | str:
    """The image_id of a file: the number its name ends in (COCO's way), else its name."""
    if image is None:
        raise RowError(f"{_WHERE}: no image is listed, so there is no file name to look for")
    stem = PurePosixPath(image).stem
    digits = re.search(r"\d+$", stem)
    return int(digits[0]) if digits else stem


def _key(number: Any) -> int | str:
    text = str(number)
    return int(text) if text.isdecimal() else text


def _size(record: dict[str, Any], sample: dict[str, Any], root: Path | None) -> tuple[int, int]:
    """Width and height, px, from the record, the sample, or the image's header."""
    for known in (record, sample):
        if known.get("width") and known.get("height"):
            if known["width"] * known["height"] > images.MAX_PIXELS:
                raise RowError(
                    f"{_WHERE}: {sample['image']}: expected at most {images.MAX_PIXELS} px, found "
                    f"{known['width']} x {known['height']}"
                )
            return known["width"], known["height"]
    if root is None:
        raise RowError(
            f"{_WHERE}: {sample['image']}: the image's size is not known; give the dataset's root, "
            "or coco-detections:JSON:IMAGES with a file that lists the images"
        )
    try:
        return images.image_size(root / sample["image"])
    except RowError as error:
        raise RowError(f"{sample['image']}: {error}") from error


def _file_names(argument: str | None) -> list[Path]:
    paths = [Path(name) for name in (argument or "").split(":") if name]
    if not 1 <= len(paths) <= 2:
        raise UsageError(f"{_WHERE}: write coco-detections:JSON or coco-detections:JSON:IMAGES")
    return paths


def _read(
    argument: str | None, names: str | None
) -> tuple[list[dict[str, Any]], list[dict[str, Any]], ClassTable]:
    """Results, images (none when no file lists them) and the class table."""
    contents = []
    for path in _file_names(argument):
        try:
            contents.append(json.loads(path.read_bytes()))
        except (OSError, ValueError, RecursionError) as error:
            raise RsaDataError(
                f"{_WHERE}: expected a JSON file at {path}; found: {error}"
            ) from error
    first, paths = contents[0], _file_names(argument)
    results = first.get("annotations") if isinstance(first, dict) else first
    wanted = {"image_id", "category_id"}
    if not isinstance(results, list) or not all(
        isinstance(result, dict) and wanted <= result.keys() for result in results
    ):
        raise RsaDataError(
            f"{_WHERE}: expected a list of results with image_id and category_id, or an object "
            f"with such a list as annotations, in {paths[0]}"
        )
    coco_json.check(results, coco_json.RESULT, f"{_WHERE}: {paths[0].name}: results")
    last = contents[-1] if isinstance(contents[-1], dict) else {}
    listed = last.get("images") or []
    coco_json.check(listed, coco_json.IMAGE, f"{_WHERE}: {paths[-1].name}: images")
    if names is not None:
        path = Path(names)
        table = class_names.read(path) if path.is_file() else class_names.table(names)
    elif last.get("categories"):
        table = categories(last, paths[-1])
    else:
        table = class_names.table("coco-panoptic")
    return results, listed, table
