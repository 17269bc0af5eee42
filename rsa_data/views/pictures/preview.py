"""A contact sheet of what was found: some images with their boxes or masks, names and shares."""

from pathlib import Path
from typing import Any

import numpy as np

from ...common.errors import RowError, RsaDataError
from ...datasets import index
from ...datasets.images import read_image
from ...segments import masks
from ...segments.segments import Segments, from_row
from ...store.tables import WorkDir
from .pictures import draw_segments, segment_grid

# Class names below a picture; the rest is counted.
_NAMED = 6


def preview(
    work: WorkDir, dataset: str, table: str, count: int, root: Path | None = None
) -> np.ndarray:
    """uint8 (h, w, 3), RGB: `count` samples, evenly over the finished parts of a segments table.

    Raises RsaDataError when no part is finished, or the dataset's images are not at hand.
    """
    place = index.find_root(work, dataset, root)
    if place is None:
        raise index.missing_root(index.load_dataset(work, dataset))
    pictures = [
        draw(place, sample, from_row(row)) for sample, row in _choose(work, dataset, table, count)
    ]
    if not pictures:
        raise RsaDataError(f"{dataset}/{table}: expected a finished part to show; found none")
    return segment_grid(pictures)


def draw(root: Path, sample: dict[str, Any], found: Segments | RowError) -> tuple[np.ndarray, str]:
    """A sample's picture with its segments, and the text to put below it."""
    text = sample["sample_id"]
    try:
        if sample["image"] is None:
            raise RowError("no image is listed")
        image = read_image(root / sample["image"])
    except RowError as error:
        return np.full((240, 480, 3), 200, np.uint8), f"{text}\n{error}"
    if isinstance(found, RowError):
        return image, f"{text}\nfailed: {found}"
    shown = None
    if found.mask is not None and found.width is not None and found.height is not None:
        shown = masks.decode(found.mask, found.height, found.width)
    order = np.argsort(-found.area, kind="stable")
    names = [f"{found.label[k]} {found.area[k]:.1%}" for k in order[:_NAMED]]
    if len(order) > _NAMED:
        names.append(f"and {len(order) - _NAMED} more")
    return draw_segments(image, found, masks=shown), f"{text}\n{', '.join(names) or 'nothing'}"


def _choose(
    work: WorkDir, dataset: str, name: str, count: int
) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """(sample, segments row) of rows that lie evenly over the finished parts."""
    table, samples = work.table(dataset, name), work.table(dataset, "samples")
    parts = table.parts()
    sizes = [table.receipt(number).rows for number in parts]
    ends = np.cumsum(sizes)
    total = int(ends[-1]) if parts else 0
    rows = np.unique(np.linspace(0, total - 1, min(count, total)).round().astype(int))
    chosen = []
    for number, end, size in zip(parts, ends.tolist(), sizes, strict=True):
        places = (rows[(rows >= end - size) & (rows < end)] - (end - size)).tolist()
        if places:
            pairs = samples.read(number).take(places), table.read(number).take(places)
            chosen += list(zip(*(pair.to_pylist() for pair in pairs), strict=True))
    return chosen
