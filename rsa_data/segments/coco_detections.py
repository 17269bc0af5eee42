"""Segments of COCO detection results or instance annotations: boxes, polygons or run lengths."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa

from ..common import class_names, names_files
from ..common.class_names import ClassTable
from ..common.errors import RowError, RsaDataError, UsageError
from ..common.prefetch import each
from ..common.ranges import Share
from ..datasets import partners
from ..datasets.dataset import Dataset
from ..datasets.roots import readers
from . import coco_json, coco_masks, crowds, frames
from .found import Found, to_segments
from .segments import Segments, to_table

_WHERE = "segments/coco-detections"


def build(
    *,
    argument: str | None,
    dataset: Dataset,
    root: Path | None,
    images: Sequence[str] | None = None,
    names: str | None = None,
    score_threshold: Share | None = None,
    masks: bool = False,
    crowd: Literal["omit", "stuff"] = "omit",
    **_: Any,
) -> Callable[[pa.Table], pa.Table]:
    """coco-detections:JSON[:IMAGES]: COCO detection results or instance annotations.

    argument : JSON, or JSON:IMAGES where IMAGES is an annotation file with the images' names and
        sizes. Without one, an image_id is an image's stem, or the number that its stem is or ends
        in; an image that no result names is a failed row then, as the file may not cover it.
    images : the images of the whole dataset, so that no result belongs to two.
    names : class table of the category ids, where the files name none; COCO's own otherwise.
    """
    results, listed, table = _read(argument, names)
    file = _file_names(argument)[0].name
    crowds.require_some_single(results, crowd, f"{_WHERE}: {file}")
    by_image: dict[partners.Key, list[dict[str, Any]]] = {}
    for result in results:
        by_image.setdefault(partners.number_key(result["image_id"]), []).append(result)
    records = {partners.number_key(record["id"]): record for record in listed or ()}
    pairs = [(key, record["file_name"]) for key, record in records.items()]

    def matched(known: Sequence[str]) -> dict[str, partners.Key | None]:
        if listed is not None:
            return partners.by_file_name(known, pairs)
        return partners.by_number(known, by_image)

    whole = None
    if images is not None:
        whole = matched(images)
        partners.require_some(whole, images, f"{_WHERE}: {file}", "results or records")
        if listed is None:
            _all_used(by_image, whole, images, file)

    def one(sample: dict[str, Any], found: dict[str, partners.Key | None]) -> Segments:
        image = sample["image"]
        what = "record" if listed is not None else "result (or a record in JSON:IMAGES)"
        key = partners.partner(found, image, f"{_WHERE}: {file}", what)
        record = {k: sample.get(k) for k in ("width", "height")} | records.get(key, {})
        try:
            frame = frames.of_image(root, image)
            mine = by_image.get(key, [])
            return segments(
                mine, record, frame, table, masks, crowd=crowd, threshold=score_threshold or 0.0
            )
        except RowError as error:
            raise RowError(f"{_WHERE}: image {key}: {error}") from error

    def step(samples: pa.Table) -> pa.Table:
        rows = samples.select(["image", "width", "height"]).to_pylist()
        found = whole
        if found is None:
            found = matched([row["image"] for row in rows if row["image"] is not None])
        done = each(lambda row: one(row, found), rows, readers(root))
        return to_table(samples["sample_id"].to_pylist(), done)

    return step


def files(*, argument: str | None, names: str | None = None, **_: Any) -> dict[str, Path]:
    """The JSON files, and the file of names where they come from one."""
    found = dict(zip(("results", "images"), _file_names(argument), strict=False))
    return found | ({"names": Path(names)} if names and Path(names).is_file() else {})


def segments(
    results: Iterable[dict[str, Any]],
    record: dict[str, Any],
    frame: frames.Frame | None,
    table: ClassTable,
    with_masks: bool = False,
    *,
    crowd: str = "omit",
    threshold: float = 0.0,
) -> Segments:
    """Segments of one image, best first; shares are of the masks where there are any.

    results : bbox (x, y, w, h, px) or segmentation (RLE or polygons), category_id, score, iscrowd.
    record : width and height, px, where the file says them.  frame : of the image, if at hand.
    Raises RowError when a result has neither box nor mask, or one that the image cannot have.
    """
    given = [r for r in results if r.get("score", 1.0) >= threshold]
    ordered = sorted(given, key=lambda result: -result.get("score", 1.0))
    for result in ordered:
        if len(result.get("bbox") or ()) != 4 and not result.get("segmentation"):
            raise RowError(f"expected bbox = [x, y, w, h] or a segmentation, found {result}")
    boxed = [r["bbox"] for r in ordered if len(r.get("bbox") or ()) == 4]
    boxes = np.array(boxed, np.float64).reshape(-1, 4)
    width, height, turn = frames.size_of(record, frame, boxes, not ordered)
    frames.check_boxes(boxes, width, height)
    ordered, labels, things = crowds.sort_out(ordered, table, crowd)
    number = np.array([result["category_id"] for result in ordered], np.int64)
    score = np.array([result.get("score", 1.0) for result in ordered], np.float32)
    shown = (width, height) if turn < 5 else (height, width)
    if any(result.get("segmentation") for result in ordered):
        decoded = [coco_masks.decode(result, width, height) for result in ordered]
        for result, mask in zip(ordered, decoded, strict=True):
            coco_masks.check_meets_box(result, mask)
        decoded = [frames.turned(mask, turn) for mask in decoded]
        found = Found(number, score, masks=decoded, is_thing=things, label=labels)
        return to_segments(found, *shown, table, with_masks=with_masks)
    box = np.array([result["bbox"] for result in ordered], np.float64).reshape(-1, 4)
    box[:, 2:] += box[:, :2]
    box = frames.turned_boxes(box, width, height, turn)
    return to_segments(Found(number, score, box, is_thing=things, label=labels), *shown, table)


def _all_used(
    by_image: dict[partners.Key, list[dict[str, Any]]],
    found: dict[str, partners.Key | None],
    images: Sequence[str],
    file: str,
) -> None:
    """Raises RsaDataError when results belong to no image of the dataset, by their ids alone."""
    claimed = {key for key in found.values() if key is not None}
    # What several images claim is a failed row of each of them.
    if not (orphans := [key for key in by_image if key not in claimed]) or None in found.values():
        return
    raise RsaDataError(
        f"{_WHERE}: {file}: expected an image_id to be the stem of one of {len(images)} images, or "
        f"its number; found {len(orphans)} of {len(by_image)} ids that belong to none: "
        f"{partners.some(orphans)}. Write coco-detections:JSON:IMAGES with the annotation file "
        "that lists the images under these ids"
    )


def _file_names(argument: str | None) -> list[Path]:
    paths = [Path(name) for name in (argument or "").split(":") if name]
    if not 1 <= len(paths) <= 2:
        raise UsageError(f"{_WHERE}: write coco-detections:JSON or coco-detections:JSON:IMAGES")
    return paths


def _read(
    argument: str | None, names: str | None
) -> tuple[list[dict[str, Any]], list[dict[str, Any]] | None, ClassTable]:
    """Results, images (None when no file lists them) and the class table."""
    paths = _file_names(argument)
    contents = [coco_json.load(path, _WHERE) for path in paths]
    first = contents[0]
    results = first.get("annotations") if isinstance(first, dict) else first
    wanted = {"image_id", "category_id"}
    if not isinstance(results, list) or not all(
        isinstance(result, dict) and wanted <= result.keys() for result in results
    ):
        raise RsaDataError(
            f"{_WHERE}: expected a list of results with image_id and category_id, or an object "
            f"with such a list as annotations, in {paths[0]}"
        )
    where = f"{_WHERE}: {paths[0].name}: results"
    coco_json.check(results, coco_json.RESULT, where)
    last = contents[-1] if isinstance(contents[-1], dict) else {}
    listed = last.get("images")
    if listed is not None:
        at = f"{_WHERE}: {paths[-1].name}: images"
        listed = coco_json.images(listed, at)
        coco_json.once([partners.number_key(record["id"]) for record in listed], f"{at}: id")
        ids = {partners.number_key(record["id"]) for record in listed}
        strange = {r["image_id"] for r in results if partners.number_key(r["image_id"]) not in ids}
        if strange:
            raise RsaDataError(
                f"{where}: expected image ids of {paths[-1].name}, found {len(strange)} that it "
                f"does not list: {partners.some(sorted(strange, key=str))}"
            )
    if names is not None:
        path = Path(names)
        table = names_files.read(path) if path.is_file() else class_names.table(names)
    elif last.get("categories"):
        table = coco_json.categories(last, str(paths[-1]))
    else:
        table = class_names.table("coco-panoptic")
    coco_json.known_classes([result["category_id"] for result in results], table, where)
    _in_pixels(results, where)
    return results, listed, table


def _in_pixels(results: list[dict[str, Any]], where: str) -> None:
    """Raises RsaDataError when all boxes of a file are shares of the image."""
    boxes = [result["bbox"] for result in results if len(result.get("bbox") or ()) == 4]
    if boxes and max(max(box) for box in boxes) <= 1:
        raise RsaDataError(
            f"{where}: expected boxes in px, found {len(boxes)} with no number above 1, such as "
            f"{boxes[0]}: shares of the image, as YOLO writes them. Multiply them by its size"
        )
