"""The objects that a caption would name, for heads that read objects instead of a sentence."""

import numpy as np
import pyarrow as pa

from ..common import class_names
from .blocks import classes_of, good_rows
from .choose import CAPTIONS_A_BLOCK, choose
from .compose import altered, deletion
from .options import Augmentation, Contents, WrongObjects


def described(
    segments: pa.Table,
    samples: pa.Table,
    variant: int,
    *,
    augmentation: Augmentation,
    contents: Contents = Contents(),
    wrong: WrongObjects = WrongObjects(),
) -> pa.Table:
    """Segments with the objects of one caption of each image, as if a text had no token limit.

    The same seed deletes, replaces and adds the same objects as in the captions of that seed.

    variant : which caption, 0 for the plain one. Rows that are ok only, in the order of samples,
    with the columns sample_id, status, error, label, area, center, is_thing, width and height of a
    segments table; the objects of variant 0 largest first, those of others in their drawn order.
    """
    segments, samples = good_rows(segments, samples)
    label, names = classes_of(segments)
    things = _things(segments, label, names)
    lengths = [len(row) for row in segments["label"].to_pylist()]
    ends = np.cumsum([0, *lengths])
    size = max(1, CAPTIONS_A_BLOCK // augmentation.variants)
    pieces = []
    for start in range(0, max(len(segments), 1), size):
        rows = segments.slice(start, size)
        own = label[ends[start] : ends[min(start + size, len(segments))]]
        found, keys, plain, classes = altered(
            rows, samples.slice(start, size), own, names, augmentation, contents, wrong
        )
        free = np.full(keys.shape, 2**30, np.int32)
        each = np.ones(len(found.label), np.int32)  # a cost of 0 would look like no object at all
        opening = np.zeros(keys.shape[1], np.int32)
        chosen = choose(
            found.first, each, opening, free, keys, plain, deletion(found, augmentation)
        )
        image, which = np.divmod(chosen.caption, augmentation.variants)
        kept = (which == variant) & (chosen.object >= 0)
        image, taken = image[kept], found.take(chosen.object[kept])
        first = np.searchsorted(image, np.arange(len(rows) + 1))
        names_ = np.array(classes, object)[taken.label] if classes else np.array([], object)
        pieces.append(
            pa.table(
                {
                    "sample_id": rows["sample_id"],
                    "status": rows["status"],
                    "error": rows["error"],
                    "label": _lists(names_, first, pa.string()),
                    "area": _lists(taken.area, first, pa.float64()),
                    "center": _places(taken.center, first),
                    "is_thing": _lists(np.array([things[n] for n in names_], bool), first, None),
                    "width": rows["width"],
                    "height": rows["height"],
                }
            )
        )
    return pa.concat_tables(pieces)


def _things(segments: pa.Table, label: np.ndarray, names: list[str]) -> dict[str, bool]:
    """Whether the objects of a class can be counted, by its name: as COCO says, else segments."""
    coco = class_names.table("coco-panoptic")
    found = {class_names.clean(name): number in coco.things for number, name in coco.names.items()}
    flags = [flag for row in segments["is_thing"].to_pylist() for flag in row]
    return found | {names[number]: flag for number, flag in zip(label, flags, strict=True)}


def _lists(values: np.ndarray, first: np.ndarray, kind: pa.DataType | None) -> pa.Array:
    return pa.ListArray.from_arrays(pa.array(first, pa.int32()), pa.array(values, kind))


def _places(center: np.ndarray | None, first: np.ndarray) -> pa.Array:
    point = pa.list_(pa.float32(), 2)
    if center is None:
        return pa.nulls(len(first) - 1, pa.list_(point))
    flat = pa.FixedSizeListArray.from_arrays(pa.array(center.ravel(), pa.float32()), 2)
    return pa.ListArray.from_arrays(pa.array(first, pa.int32()), flat)
