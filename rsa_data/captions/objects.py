"""What the segments of a block of images say, as flat columns: one entry an object."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ..common.errors import RsaDataError

Which = Literal["all", "things", "background"]

# An object and those that are inserted must fit into 16 bits of a sorting key.
MAX_OBJECTS = 60_000


@dataclass(frozen=True)
class Objects:
    """Objects of a block of images, image after image, largest first, ties in their own order.

    label : int32 of shape (n,), index into the labels of the part.
    count : int32 of shape (n,), instances that the object stands for: 1 unless grouped.
    area : float64 of shape (n,), share of the full image, 0 to 1; of a group the sum, at most 1.
    center : float32 of shape (n, 2), px, x y, or None when a source has none.
    cell : int8 of shape (n,), cell of a 3 x 3 grid, 0 to 8 row by row, or None as `center`.
    size : float64 of shape (images, 2), px, width and height, or None when one is not known.
    image : int64 of shape (n,), the image's place in the block.
    first : int64 of shape (images + 1,), where each image's objects begin.
    """

    label: np.ndarray
    count: np.ndarray
    area: np.ndarray
    center: np.ndarray | None
    cell: np.ndarray | None
    size: np.ndarray | None
    image: np.ndarray
    first: np.ndarray

    def take(self, rows: np.ndarray) -> "Objects":
        """The objects of the given rows, in their order; `first` stays that of all."""
        center = None if self.center is None else self.center[rows]
        cell = None if self.cell is None else self.cell[rows]
        return replace(
            self,
            label=self.label[rows],
            count=self.count[rows],
            area=self.area[rows],
            center=center,
            cell=cell,
            image=self.image[rows],
        )


def from_segments(
    segments: pa.Table,
    samples: pa.Table,
    label: np.ndarray,
    which: Which = "all",
    group: bool = False,
) -> Objects:
    """The objects of a block of a segments table.

    samples : the same images' rows of the samples table.
    label : int32 of shape (segments,), a number for the class of each segment.
    which : things (countable), background (stuff), or all.
    group : equal classes of an image become one object with their count and summed area.
    Raises RsaDataError when an image has more than MAX_OBJECTS segments, or one's share is not in
    0 to 1.
    """
    images = len(segments)
    lengths = pc.list_value_length(segments["label"]).to_numpy()
    if images and lengths.max() > MAX_OBJECTS:
        name = segments["sample_id"][int(lengths.argmax())].as_py()
        raise RsaDataError(
            f"captions: {name}: expected at most {MAX_OBJECTS} segments, found {lengths.max()}"
        )
    image = np.repeat(np.arange(images), lengths)
    area = pc.list_flatten(segments["area"]).to_numpy()
    if not ((area >= 0) & (area <= 1)).all():
        row = int(np.flatnonzero(~((area >= 0) & (area <= 1)))[0])
        name = segments["sample_id"][int(image[row])].as_py()
        raise RsaDataError(
            f"captions: {name}: expected shares of the image from 0 to 1 in segments, found "
            f"{area[row]}"
        )
    rows = np.arange(len(label))
    if which != "all":
        things = pc.list_flatten(segments["is_thing"]).to_numpy()
        rows = np.flatnonzero(things if which == "things" else ~things)
        label, area, image = label[rows], area[rows], image[rows]
    center = None if group else _places(segments, "center", rows, 2)
    cell = None if group else _places(segments, "cell", rows, 1)
    count = np.ones(len(label), np.int32)
    if group:
        label, count, area, image = _grouped(label, area, image)
    order, first = largest_first(area, image, images)
    size = _sizes(segments, samples)
    return Objects(label, count, area, center, cell, size, image, first).take(order)


def _places(segments: pa.Table, name: str, rows: np.ndarray, sides: int) -> np.ndarray | None:
    """The column `center` or `cell` of some segments; None where a row has none."""
    if name not in segments.column_names:  # tables of schema version 1 have no cells
        return None
    column = segments[name]
    known = pc.or_kleene(column.is_valid(), pc.equal(pc.list_value_length(segments["label"]), 0))
    if not pc.all(known).as_py():
        return None
    flat = pc.list_flatten(column)
    flat = flat.combine_chunks() if isinstance(flat, pa.ChunkedArray) else flat
    values: np.ndarray = (flat.flatten() if sides > 1 else flat).to_numpy()
    chosen: np.ndarray = (values.reshape(-1, sides) if sides > 1 else values)[rows]
    return chosen


def _sizes(segments: pa.Table, samples: pa.Table) -> np.ndarray | None:
    columns = [pc.coalesce(segments[name], samples[name]) for name in ("width", "height")]
    if any(column.null_count for column in columns):
        return None
    return np.stack([column.to_numpy() for column in columns], 1).astype(np.float64)


def _grouped(
    label: np.ndarray, area: np.ndarray, image: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """One object for each class of each image, in order of the class's number."""
    classes = int(label.max(initial=0)) + 1
    keys, member = np.unique(image * classes + label, return_inverse=True)
    count = np.bincount(member, minlength=len(keys)).astype(np.int32)
    # Boxes overlap, so their shares may sum to more than the image.
    total = np.minimum(np.bincount(member, area, len(keys)), 1.0)
    return (keys % classes).astype(np.int32), count, total, keys // classes


def largest_first(
    area: np.ndarray, image: np.ndarray, images: int
) -> tuple[np.ndarray, np.ndarray]:
    """The order that puts each image's largest object first, and where each image begins.

    One unsigned key holds image, area and index, because NumPy sorts plain integers many times
    faster than by several columns. Shares that differ by less than 2**-32 count as equal.
    """
    sizes = np.bincount(image, minlength=images)
    first = np.concatenate([[0], np.cumsum(sizes)])
    if not len(area):
        return np.arange(0), first
    index = np.arange(len(area)) - first[image]
    small = (np.rint((1.0 - area) * (2**32 - 1))).astype(np.uint64)
    key = (image.astype(np.uint64) << np.uint64(48)) | (small << np.uint64(16))
    key |= index.astype(np.uint64)
    key.sort()
    return first[image] + (key & np.uint64(0xFFFF)).astype(np.int64), first
