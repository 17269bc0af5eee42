"""What a decoder finds in one image, and how that becomes segments."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..common.class_names import ClassTable
from . import masks
from .segments import Segments


@dataclass(frozen=True)
class Found:
    """What a decoder finds, best first or in the order of the model's queries.

    number : int of shape (n,), class numbers.
    score : float of shape (n,), 0 to 1.
    box : float of shape (n, 4), px of the image, x1 y1 x2 y2, not clipped; None with masks.
    index : int of shape (height, width), which of the n each pixel belongs to, negative: none.
    masks : n bool arrays of shape (height, width) that may overlap.
    query : int of shape (n,), row of each in the graph's outputs, for its features.
    candidates : how many rows the graph proposed.
    is_thing : bool of shape (n,) where the decoder decides it, else the class table does.
    label : n labels where they are not the class table's names.

    One of box, index and masks is given.
    """

    number: np.ndarray
    score: np.ndarray
    box: np.ndarray | None = None
    index: np.ndarray | None = None
    masks: Sequence[np.ndarray] | None = None
    query: np.ndarray | None = None
    candidates: int | None = None
    is_thing: np.ndarray | None = None
    label: Sequence[str] | None = None


def to_segments(
    found: Found,
    width: int,
    height: int,
    table: ClassTable,
    features: np.ndarray | None = None,
    with_masks: bool = False,
) -> Segments:
    """Segments with shares of the full image; those without a pixel or a name are left out.

    width, height : px, of the image.  features : float of shape (queries, d).
    """
    pixels, box, center, cell = _measure(found, width, height)
    named = [found.label is not None or n in table.names for n in found.number.tolist()]
    keep = np.flatnonzero((pixels > 0) & np.array(named, bool))
    numbers = found.number[keep]
    things = (
        found.is_thing[keep]
        if found.is_thing is not None
        else np.array([n in table.things for n in numbers.tolist()], bool)
    )
    encoded = None
    if with_masks and found.index is not None:
        encoded = masks.encode([found.index == k for k in keep])
    elif with_masks and found.masks is not None:
        encoded = masks.encode([found.masks[k] for k in keep.tolist()])
    return Segments(
        label=[table.label(n) for n in numbers.tolist()]
        if found.label is None
        else [found.label[k] for k in keep.tolist()],
        area=np.minimum(pixels[keep] / (width * height), 1.0),
        score=np.clip(found.score[keep], 0, 1).astype(np.float32),
        is_thing=things,
        box=box[keep],
        width=width,
        height=height,
        center=center[keep],
        mask=encoded,
        cell=cell[keep],
        feature=None if features is None or found.query is None else features[found.query[keep]],
    )


def _measure(
    found: Found, width: int, height: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (n,), box (n, 4) and centre (n, 2), px, and cell (n,) of what was found."""
    count = len(found.number)
    if found.index is not None:
        return masks.regions(found.index, count)
    if found.box is not None:
        box = np.clip(found.box, 0, [width, height, width, height]).astype(np.float32)
        sides = np.maximum(box[:, 2:] - box[:, :2], 0).astype(np.float64)
        cell = masks.cells_of_boxes(box, width, height)
        return sides[:, 0] * sides[:, 1], box, (box[:, :2] + box[:, 2:]) / 2, cell
    pixels, box, center = np.zeros(count), np.zeros((count, 4)), np.zeros((count, 2))
    cell = np.zeros(count, np.int8)
    for k, mask in enumerate(found.masks or ()):
        one = masks.regions(np.where(mask, 0, -1), 1)
        pixels[k : k + 1], box[k], center[k], cell[k] = one[0], one[1], one[2], one[3][0]
    return pixels, box, center, cell
