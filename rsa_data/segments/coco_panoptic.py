"""Segments of COCO panoptic annotations: a JSON file and a folder of PNG id maps."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pyarrow as pa

from ..common.class_names import ClassTable, clean
from ..common.errors import RowError, RsaDataError
from ..common.prefetch import each
from ..datasets.dataset import Dataset
from ..datasets.listing import inside
from ..datasets.roots import readers
from . import coco_json, maps
from .found import Found, to_segments
from .segments import Segments, to_table

_WHERE = "segments/coco-panoptic"


def build(
    *,
    argument: str | None,
    dataset: Dataset,
    root: Path | None,
    masks: bool = False,
    **_: Any,
) -> Callable[[pa.Table], pa.Table]:
    """coco-panoptic:JSON[:DIR]: COCO panoptic annotations, matched by the image's file name.

    argument : JSON, or JSON:DIR where DIR holds the PNG files; otherwise they lie in a folder
        named as the JSON file, or beside it. None: the JSON that the dataset itself brings.
    """
    if argument is None and dataset.panoptic is not None and root is not None:
        argument = str(root / dataset.panoptic)
    path = _json_path(argument)
    content = read_json(path, ("images", "annotations", "categories"), _WHERE)
    folder = _png_folder(path, argument)
    where = f"{_WHERE}: {path.name}"
    coco_json.check(content["images"], coco_json.IMAGE, f"{where}: images")
    annotations = coco_json.check(
        content["annotations"], coco_json.PANOPTIC, f"{where}: annotations"
    )
    for annotation in annotations:
        name = annotation["file_name"]
        inside(name, where)
        coco_json.check(annotation["segments_info"], coco_json.SEGMENT, f"{where}: {name}")
    table = categories(content, path)
    by_name = ByFileName(content["images"], path.name)
    by_image = {annotation["image_id"]: annotation for annotation in annotations}

    def one(image: str | None) -> Segments:
        record = by_name.find(image)
        if record["id"] not in by_image:
            raise RowError(f"{record['file_name']}: expected its annotation in {path.name}")
        annotation = by_image[record["id"]]
        try:
            ids = maps.read_colour_ids(folder / annotation["file_name"])
            maps.check_size(ids, root, image, "id map")
            return segments(ids, annotation["segments_info"], record, table, masks)
        except RowError as error:
            raise RowError(f"{_WHERE}: {annotation['file_name']}: {error}") from error

    def step(samples: pa.Table) -> pa.Table:
        return to_table(
            samples["sample_id"].to_pylist(),
            by_name.each_once(samples["image"].to_pylist(), one, readers(root)),
        )

    return step


def files(*, argument: str | None, **_: Any) -> dict[str, Path]:
    """The JSON file, unless it is the one that the dataset brings."""
    return {} if argument is None else {"json": _json_path(argument)}


def segments(
    ids: np.ndarray,
    infos: list[dict[str, Any]],
    record: dict[str, Any],
    table: ClassTable,
    with_masks: bool = False,
) -> Segments:
    """Segments of one image in the order of the JSON; every area is counted in the map.

    ids : int32 (height, width), 0 where nothing is annotated.
    Raises RowError unless map and JSON hold the same ids, each with the area that the JSON says.
    """
    height, width = ids.shape
    if (record.get("width", width), record.get("height", height)) != (width, height):
        raise RowError(
            f"expected {record.get('width', '?')} x {record.get('height', '?')} pixels, as the "
            f"JSON says, "
            f"found {width} x {height}"
        )
    there, inverse, pixels = np.unique(ids, return_inverse=True, return_counts=True)
    wanted = np.array([info["id"] for info in infos], np.int64)
    if missing := sorted(set(there.tolist()) - {0, *wanted.tolist()}):
        raise RowError(f"ids of the map that the JSON does not have: {_some(missing)}")
    if missing := sorted(set(wanted.tolist()) - set(there.tolist())):
        raise RowError(f"ids of the JSON that the map does not have: {_some(missing)}")
    place = {int(i): k for k, i in enumerate(there)}
    for info in infos:
        count = int(pixels[place[info["id"]]])
        if info.get("area", count) != count:
            raise RowError(
                f"segment {info['id']}: expected {info['area']} pixels, as the JSON says, "
                f"found {count}"
            )
    order = np.full(len(there), -1, np.int32)
    for k, info in enumerate(infos):
        order[place[info["id"]]] = k
    number = np.array([info["category_id"] for info in infos], np.int64)
    index = order[inverse.reshape(ids.shape)]
    found = Found(number, np.ones(len(infos)), index=index)
    return to_segments(found, width, height, table, with_masks=with_masks)


def _some(ids: list[int]) -> str:
    return ", ".join(map(str, ids[:5])) + (f" and {len(ids) - 5} more" if len(ids) > 5 else "")


def categories(content: dict[str, Any], path: Path) -> ClassTable:
    """The class table of a COCO file's categories."""
    given = coco_json.check(content.get("categories"), coco_json.CATEGORY, f"{path}: categories")
    names = {c["id"]: clean(c["name"]) for c in given}
    things = frozenset(c["id"] for c in given if c.get("isthing", 1))
    return ClassTable(names, things, max(names, default=-1) + 1)


def read_json(path: Path, keys: tuple[str, ...], where: str) -> dict[str, Any]:
    """A JSON object that has lists under `keys`; raises RsaDataError when it is not that."""
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise RsaDataError(f"{where}: expected a JSON file at {path}; found: {error}") from error
    lists: dict[str, Any] = content if isinstance(content, dict) else {}
    for key in keys:
        if not isinstance(lists.get(key), list):
            raise RsaDataError(f"{where}: expected a list {key!r} in {path}; found none")
    return lists


class ByFileName:
    """Finds an image's record by its file name, however much of its path the record has."""

    def __init__(self, records: list[dict[str, Any]], where: str):
        self.where = where
        self.records: dict[str, dict[str, Any] | None] = {}
        for record in records:
            name = PurePosixPath(record["file_name"]).with_suffix("").as_posix()
            # Two records of one name: neither is the right one for certain.
            self.records[name] = None if name in self.records else record

    def find(self, image: str | None) -> dict[str, Any]:
        """The record whose file name, without its suffix, is the end of the image's path.

        Raises RowError when there is none, or more than one.
        """
        if image is None:
            raise RowError("no image is listed, so there is no file name to look for")
        parts = PurePosixPath(image).with_suffix("").parts
        for start in range(len(parts)):
            name = "/".join(parts[start:])
            if name in self.records:
                record = self.records[name]
                if record is None:
                    raise RowError(f"{self.where}: expected one image {name}, found several")
                return record
        raise RowError(f"{self.where}: expected an image {image} or {parts[-1]}, found none")

    def each_once(
        self, paths: list[str | None], one: Callable[[str | None], Segments], helpers: int
    ) -> Iterator[Segments | RowError]:
        """`one` of each path; a record that two paths would share is an error for both."""
        owners: dict[str, list[str | None]] = {}
        for path in paths:
            try:
                owners.setdefault(self.find(path)["file_name"], []).append(path)
            except RowError:
                continue

        def alone(path: str | None) -> Segments:
            name = self.find(path)["file_name"]
            if len(owners[name]) > 1:
                raise RowError(f"{self.where}: image {name} would stand for several samples")
            return one(path)

        return each(alone, paths, helpers)


def _json_path(argument: str | None) -> Path:
    path = Path((argument or "").partition(":")[0])
    if not path.is_file():
        raise RsaDataError(
            f"{_WHERE}: expected a JSON file; found none at {str(path)!r}. "
            "Write coco-panoptic:JSON, or coco-panoptic:JSON:DIR with the folder of the PNG files"
        )
    return path


def _png_folder(path: Path, argument: str | None) -> Path:
    given = (argument or "").partition(":")[2]
    folder = Path(given) if given else path.with_suffix("")
    if not folder.is_dir():
        if given:
            raise RsaDataError(f"{_WHERE}: expected a folder of PNG files at {folder}; found none")
        return path.parent
    return folder
