"""Pixel masks -> exact shares, boxes and centres, all counted at the image's own size."""

import warnings
from collections.abc import Sequence

import numpy as np

from ..common.extras import extras


def regions(index: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pixels, box, centre of mass and cell of each region of an index map.

    index : int of shape (height, width); region of each pixel, 0 to count - 1, or negative: none.
    Returns pixels int64 (count,), box float32 (count, 4) x1 y1 x2 y2, px, x2 and y2 exclusive,
    centre float32 (count, 2) x y, px, and cell int8 (count,), the one of a 3 x 3 grid, row by row,
    with most of its pixels. Regions without pixels have box, centre and cell 0.
    """
    height, width = index.shape
    inside = np.where(index < 0, count, index)
    # Everything follows from how many pixels each region has in each row and in each column.
    rows = inside + np.arange(height)[:, None] * (count + 1)
    in_row = np.bincount(rows.ravel(), minlength=height * (count + 1)).reshape(height, -1)
    columns = inside + np.arange(width)[None] * (count + 1)
    in_column = np.bincount(columns.ravel(), minlength=width * (count + 1)).reshape(width, -1)
    in_row, in_column = in_row[:, :count], in_column[:, :count]
    pixels = in_row.sum(0)
    (x1, x2, x), (y1, y2, y) = _extent(in_column, pixels), _extent(in_row, pixels)
    nine = 3 * _third(height)[:, None] + _third(width)[None]
    in_cell = np.bincount((inside + (count + 1) * nine).ravel(), minlength=9 * (count + 1))
    cell = in_cell.reshape(9, -1)[:, :count].argmax(0).astype(np.int8)
    return pixels, np.stack([x1, y1, x2, y2], 1), np.stack([x, y], 1), cell


def _third(size: int) -> np.ndarray:
    """In which third, 0 to 2, the centre of each of `size` pixels lies."""
    return ((np.arange(size) + 0.5) * 3 // size).astype(np.int64)


def cells_of_boxes(box: np.ndarray, width: int, height: int) -> np.ndarray:
    """The cell of a 3 x 3 grid, row by row, with most of each box: int8 (n,).

    box : float (n, 4) x1 y1 x2 y2, px, clipped to the image.
    """
    edges = np.arange(4) / 3
    shares = []
    for low, high, size in ((box[:, 0], box[:, 2], width), (box[:, 1], box[:, 3], height)):
        start = np.maximum(low[:, None], edges[None, :3] * size)
        end = np.minimum(high[:, None], edges[None, 1:] * size)
        shares.append(np.maximum(end - start, 0))  # (n, 3)
    across, down = shares
    # Rounded, so that thirds which are equal stay equal.
    area = np.round(down[:, :, None] * across[:, None], 3).reshape(len(box), 9)
    cell: np.ndarray = area.argmax(1).astype(np.int8)
    return cell


def _extent(counts: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First, last + 1 and mean position of each column of counts, float32 of shape (count,)."""
    size = len(counts)
    there = counts > 0
    first = there.argmax(0)
    last = size - there[::-1].argmax(0)
    mean = (np.arange(size) + 0.5) @ counts / np.maximum(pixels, 1)
    full = pixels > 0
    first, last, mean = ((full * value).astype(np.float32) for value in (first, last, mean))
    return first, last, mean


def encode(masks: Sequence[np.ndarray]) -> list[str]:
    """COCO's compressed RLE counts of some bool masks (height, width).

    Raises RsaDataError with the pip line when pycocotools is not installed.
    """
    with extras("masks"):
        from pycocotools import mask as coco_mask
    return [
        coco_mask.encode(np.asfortranarray(mask, np.uint8))["counts"].decode("ascii")
        for mask in masks
    ]


def resize(
    values: np.ndarray,
    height: int,
    width: int,
    shown: tuple[float, float, float, float] = (1.0, 1.0, 0.0, 0.0),
) -> np.ndarray:
    """A map resized bilinearly, pixel centres at .5, edges repeated (align_corners = False).

    values : float32 (h, w).  shown : shares of its height and width that show the image, and that
    lie above and left of it; what shows padding is left out.
    """
    if shown == (1.0, 1.0, 0.0, 0.0):
        import cv2

        return cv2.resize(values, (width, height), interpolation=cv2.INTER_LINEAR)
    top, bottom, y = _taps(values.shape[0], height, shown[0], shown[2])
    left, right, x = _taps(values.shape[1], width, shown[1], shown[3])
    rows = values[top] + (values[bottom] - values[top]) * y[:, None]  # (height, w)
    resized: np.ndarray = rows[:, left] + (rows[:, right] - rows[:, left]) * x  # (height, width)
    return resized


def _taps(
    size: int, wanted: int, used: float, before: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The two source rows of each wanted row, and the second one's weight (float32)."""
    where = (np.arange(wanted) + 0.5) * (size * used / wanted) - 0.5 + size * before
    where = np.clip(where, 0, size - 1)
    first = where.astype(np.int64)
    return first, np.minimum(first + 1, size - 1), (where - first).astype(np.float32)


def paste(mask: np.ndarray, box: np.ndarray, height: int, width: int) -> np.ndarray:
    """A mask that covers its box, in an image: float32 (height, width), bilinear, 0 outside.

    mask : float32 (h, w).  box : x1 y1 x2 y2, px of the image.
    As detectron2's paste_masks_in_image: the mask's border fades out over half its pixel.
    """
    x1, y1, x2, y2 = (float(side) for side in box)
    if not (x2 > x1 and y2 > y1):
        return np.zeros((height, width), np.float32)
    framed = np.pad(mask, 1)
    top, bottom, y = _box_taps(mask.shape[0], height, y1, y2)
    left, right, x = _box_taps(mask.shape[1], width, x1, x2)
    rows = framed[top] + (framed[bottom] - framed[top]) * y[:, None]  # (height, w + 2)
    resized: np.ndarray = rows[:, left] + (rows[:, right] - rows[:, left]) * x  # (height, width)
    return resized


def _box_taps(
    size: int, wanted: int, low: float, high: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `_taps`, into a mask with a frame of zeros, whose inside lies from `low` to `high`."""
    where = (np.arange(wanted) + 0.5 - low) / (high - low) * size - 0.5 + 1
    where = np.clip(where, 0, size + 1)
    first = where.astype(np.int64)
    return first, np.minimum(first + 1, size + 1), (where - first).astype(np.float32)


def decode(counts: Sequence[str], height: int, width: int) -> list[np.ndarray]:
    """The bool masks (height, width) of COCO's compressed RLE counts.

    Raises RsaDataError with the pip line when pycocotools is not installed.
    """
    with extras("masks"):
        from pycocotools import mask as coco_mask
    with warnings.catch_warnings():
        # pycocotools' arrays do not know numpy 2's copy argument yet.
        warnings.simplefilter("ignore", DeprecationWarning)
        return [
            coco_mask.decode({"size": [height, width], "counts": text}).astype(bool)
            for text in counts
        ]


def covered(counts: str | bytes) -> int:
    """Pixels that COCO's compressed RLE counts speak of, set and not set; -1 for no such counts.

    Groups of 5 bits, the lowest first, 32 says that more follow, the last one's 16 is the sign;
    from the fourth on, counts are told as the difference from the one before the last
    (cocoapi, common/maskApi.c, rleFrString).
    """
    data = counts.encode() if isinstance(counts, str) else counts
    codes = np.frombuffer(data, np.uint8).astype(np.int64) - 48
    ends = np.flatnonzero(codes & 32 == 0)
    if not len(codes) or codes.min() < 0 or codes.max() > 63 or ends[-1:] != len(codes) - 1:
        return -1
    starts = np.concatenate([[0], ends[:-1] + 1])
    place = np.arange(len(codes)) - np.repeat(starts, ends - starts + 1)
    if place.max() > 6:
        return -1
    told = np.add.reduceat((codes & 31) << 5 * place, starts)
    told -= np.where(codes[ends] & 16, np.int64(1) << 5 * (place[ends] + 1), 0)
    odd, even = np.cumsum(told[1::2]), np.cumsum(told[2::2])
    lengths = np.concatenate([told[:1], odd, even])
    return int(lengths.sum()) if lengths.min() >= 0 else -1
