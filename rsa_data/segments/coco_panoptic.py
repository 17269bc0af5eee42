"""Segments of COCO panoptic annotations: a JSON file and a folder of PNG id maps."""

from collections import Counter
from collections.abc import Callable, Container, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa

from ..common.class_names import ClassTable
from ..common.errors import RowError, RsaDataError
from ..common.prefetch import each
from ..datasets import partners
from ..datasets.dataset import Dataset
from ..datasets.listing import inside
from ..datasets.roots import readers
from . import coco_json, crowds, maps
from .found import Found, to_segments
from .segments import Segments, to_table

_WHERE = "segments/coco-panoptic"


def build(
    *,
    argument: str | None,
    dataset: Dataset,
    root: Path | None,
    images: Sequence[str] | None = None,
    masks: bool = False,
    crowd: Literal["omit", "stuff"] = "omit",
    **_: Any,
) -> Callable[[pa.Table], pa.Table]:
    """coco-panoptic:JSON[:DIR]: COCO panoptic annotations, matched by the image's file name.

    argument : JSON, or JSON:DIR where DIR holds the PNG files; otherwise they lie in a folder
        named as the JSON file, or beside it. None: the JSON that the dataset itself brings.
    images : the images of the whole dataset, so that no record belongs to two.
    """
    if argument is None and dataset.panoptic is not None and root is not None:
        argument = str(root / dataset.panoptic)
    path = _json_path(argument)
    content = read_json(path, ("images", "annotations", "categories"), _WHERE)
    folder = _png_folder(path, argument)
    where = f"{_WHERE}: {path.name}"
    records = _records(content, where)
    table = coco_json.categories(content, str(path))
    annotations = _annotations(content, records, table, where)

    def matched(known: Sequence[str]) -> dict[str, partners.Key | None]:
        return partners.by_file_name(known, [(k, r["file_name"]) for k, r in records.items()])

    whole = None if images is None else matched(images)
    if whole is not None and images is not None:
        partners.require_some(whole, images, where, "records")

    def one(image: str | None, found: dict[str, partners.Key | None]) -> Segments:
        key = partners.partner(found, image, where, "record")
        record = records[key]
        if key not in annotations:
            raise RowError(f"{record['file_name']}: expected its annotation in {path.name}")
        annotation = annotations[key]
        try:
            ids = maps.read_colour_ids(folder / annotation["file_name"].replace("\\", "/"))
            ids = maps.fitted(ids, root, image, "id map")
            return segments(ids, annotation["segments_info"], record, table, masks, crowd=crowd)
        except RowError as error:
            raise RowError(f"{_WHERE}: {annotation['file_name']}: {error}") from error

    def step(samples: pa.Table) -> pa.Table:
        names = samples["image"].to_pylist()
        found = matched([name for name in names if name is not None]) if whole is None else whole
        done = each(lambda image: one(image, found), names, readers(root))
        return to_table(samples["sample_id"].to_pylist(), done)

    return step


def _records(content: dict[str, Any], where: str) -> dict[partners.Key, dict[str, Any]]:
    """The images of the file by their ids, each once."""
    listed = coco_json.images(content["images"], f"{where}: images")
    keys = [partners.number_key(record["id"]) for record in listed]
    coco_json.once(keys, f"{where}: images: id")
    return dict(zip(keys, listed, strict=True))


def _annotations(
    content: dict[str, Any],
    records: Container[partners.Key],
    table: ClassTable,
    where: str,
) -> dict[partners.Key, dict[str, Any]]:
    """The annotations by their image's id: one each, of images and classes that the file has."""
    listed = coco_json.check(content["annotations"], coco_json.PANOPTIC, f"{where}: annotations")
    keys = [partners.number_key(annotation["image_id"]) for annotation in listed]
    coco_json.once(keys, f"{where}: annotations: image_id")
    if strange := [key for key in keys if key not in records]:
        raise RsaDataError(
            f"{where}: expected annotations of the images that it lists, found {len(strange)} of "
            f"others: {partners.some(strange)}"
        )
    numbers = []
    for annotation in listed:
        name = annotation["file_name"]
        inside(name.replace("\\", "/"), where)
        infos = coco_json.check(annotation["segments_info"], coco_json.SEGMENT, f"{where}: {name}")
        numbers += [info["category_id"] for info in infos]
    coco_json.known_classes(numbers, table, where)
    return dict(zip(keys, listed, strict=True))


def files(*, argument: str | None, **_: Any) -> dict[str, Path]:
    """The JSON file, unless it is the one that the dataset brings."""
    return {} if argument is None else {"json": _json_path(argument)}


def segments(
    ids: np.ndarray,
    infos: list[dict[str, Any]],
    record: dict[str, Any],
    table: ClassTable,
    with_masks: bool = False,
    *,
    crowd: str = "omit",
) -> Segments:
    """Segments of one image in the order of the JSON; every area is counted in the map.

    ids : int32 (height, width), 0 where nothing is annotated.
    Raises RowError unless map and JSON hold the same ids once, each with the area that the JSON
    says.
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
    if repeated := sorted({i for i, n in Counter(wanted.tolist()).items() if n > 1}):
        raise RowError(f"expected each segment id once, found several of {partners.some(repeated)}")
    if missing := sorted(set(there.tolist()) - {0, *wanted.tolist()}):
        raise RowError(f"ids of the map that the JSON does not have: {partners.some(missing)}")
    if missing := sorted(set(wanted.tolist()) - set(there.tolist())):
        raise RowError(f"ids of the JSON that the map does not have: {partners.some(missing)}")
    place = {int(i): k for k, i in enumerate(there)}
    for info in infos:
        count = int(pixels[place[info["id"]]])
        if info.get("area", count) != count:
            raise RowError(
                f"segment {info['id']}: expected {info['area']} pixels, as the JSON says, "
                f"found {count}"
            )
    kept, labels, things = crowds.sort_out(infos, table, crowd)
    order = np.full(len(there), -1, np.int32)
    for k, info in enumerate(kept):
        order[place[info["id"]]] = k
    number = np.array([info["category_id"] for info in kept], np.int64)
    index = order[inverse.reshape(ids.shape)]
    found = Found(number, np.ones(len(kept)), index=index, is_thing=things, label=labels)
    return to_segments(found, width, height, table, with_masks=with_masks)


def read_json(path: Path, keys: tuple[str, ...], where: str) -> dict[str, Any]:
    """A JSON object that has lists under `keys`; raises RsaDataError when it is not that."""
    content = coco_json.load(path, where)
    lists: dict[str, Any] = content if isinstance(content, dict) else {}
    for key in keys:
        if not isinstance(lists.get(key), list):
            raise RsaDataError(f"{where}: expected a list {key!r} in {path}; found none")
    return lists


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
