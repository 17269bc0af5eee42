"""Whether what a file says of an image's size is the image's, and in which frame its boxes lie."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..common.errors import RowError
from ..datasets import images
from ..datasets.shards import name_of

# Share of the image's side, and px, by which boxes may reach over its border: rounding, and objects
# that are completed by guess.
_OVER, _OVER_PX = 0.02, 2.0


@dataclass(frozen=True)
class Frame:
    """How an image lies in front of its viewer, and in its file.

    width, height : px, as it is displayed.
    orientation : EXIF's, 1 to 8, by which the stored pixels are turned for that.
    """

    width: int
    height: int
    orientation: int = 1

    @property
    def stored(self) -> tuple[int, int]:
        """Width and height of the pixels in the file."""
        turned = self.orientation >= 5
        return (self.height, self.width) if turned else (self.width, self.height)


def of_image(root: Path | None, image: str | None) -> Frame | None:
    """The frame of an image below `root`, by its header; None where the image is not there.

    Raises RowError, naming the image, when its file is none.
    """
    if root is None or image is None:
        return None
    try:
        width, height, orientation = images.image_frame(root / image)
    except RowError as error:
        if str(error) == images.MISSING:
            return None
        raise RowError(f"{name_of(image)}: {error}") from error
    return Frame(width, height, orientation)


def size_of(
    record: dict[str, Any], frame: Frame | None, boxes: np.ndarray, empty: bool
) -> tuple[int, int, int]:
    """Width and height that the record's boxes refer to, px, and EXIF's turn to the display.

    boxes : float (n, 4), x y w h, px.  empty : whether the image has no results at all.
    The turn is 1 where the boxes lie on the displayed image.
    Raises RowError when the record's size is neither the displayed nor the stored one, when it is
    the stored one and the boxes fit both frames or none, or when no size is known.
    """
    width, height = record.get("width"), record.get("height")
    if frame is None:
        if not width or not height:
            raise RowError("the image's size is not known; give the dataset's root, or a file that "
                           "lists the images with their sizes")  # fmt: skip
        if width * height > images.MAX_PIXELS:
            raise RowError(
                f"expected at most {images.MAX_PIXELS} px, found {width} x {height} in the record"
            )
        return width, height, 1
    displayed = frame.width, frame.height
    said = (width, height) if width and height else displayed
    if width and said == displayed and frame.stored != displayed:
        return *said, 1
    if said not in (displayed, frame.stored):
        turned = ", which is transposed" if said[::-1] == displayed else ""
        raise RowError(
            f"expected the image's size {displayed[0]} x {displayed[1]} in its record, found "
            f"{said[0]} x {said[1]}{turned}"
        )
    if frame.orientation == 1:
        return *said, 1
    fits = _fit(boxes, displayed), _fit(boxes, frame.stored)
    if not empty and fits[0] == fits[1]:
        raise RowError(
            f"the image is turned for display (EXIF orientation {frame.orientation}), and whether "
            "the file speaks of the displayed or of the stored pixels cannot be told. Write the "
            "image upright, or give its record the displayed size"
        )
    return (*displayed, 1) if fits[0] else (*frame.stored, frame.orientation)


def _fit(boxes: np.ndarray, size: tuple[int, int]) -> bool:
    return bool((boxes[:, :2] + boxes[:, 2:] <= np.array(size) + _OVER_PX).all())


def check_boxes(boxes: np.ndarray, width: int, height: int) -> None:
    """Raises RowError for boxes x y w h (px) that no image of this size has.

    Boxes may reach over the border by 2% of the side, or by 2 px.
    """
    if not len(boxes):
        return
    if not np.isfinite(boxes).all():
        raise RowError(f"expected finite boxes, found {boxes[~np.isfinite(boxes).all(1)][0]}")
    size = np.array([width, height])
    over = np.maximum(size * _OVER, _OVER_PX)
    low, high = boxes[:, :2], boxes[:, :2] + boxes[:, 2:]
    bad = (boxes[:, 2:] < 0) | (low < -over) | (high > size + over)
    if bad.any():
        box = boxes[bad.any(1)][0]
        corners = bool((box[2:] > box[:2]).all() and (box[2:] <= size + over).all())
        hint = "; it would be one as [x1, y1, x2, y2]" if corners else ""
        raise RowError(
            f"expected boxes [x, y, width, height] inside {width} x {height} px, found "
            f"{box.tolist()}{hint}"
        )


def turned(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """A map of the stored pixels, (h, w), as it lies on the displayed image."""
    return np.ascontiguousarray(images.turned(pixels, orientation))


def turned_boxes(boxes: np.ndarray, width: int, height: int, orientation: int) -> np.ndarray:
    """Boxes x1 y1 x2 y2 (px) of the stored pixels, of width x height, on the displayed image."""
    x1, y1, x2, y2 = boxes.T
    if orientation >= 5:
        x1, y1, x2, y2, width, height = y1, x1, y2, x2, height, width
    if orientation in (2, 3, 6, 7):
        x1, x2 = width - x2, width - x1
    if orientation in (3, 4, 7, 8):
        y1, y2 = height - y2, height - y1
    return np.stack([x1, y1, x2, y2], 1)
