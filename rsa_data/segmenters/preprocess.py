"""From an image to what a model's card wants to see, and the way back for coordinates."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import RowError, RsaDataError
from ..registry import unknown


@dataclass(frozen=True)
class Geometry:
    """How an image lies in the input tensor, from its top left corner.

    width, height : px, of the image.
    used_width, used_height : px of the input that show the image; the rest is padding.
    input_width, input_height : px, of the input tensor.
    """

    width: int
    height: int
    used_width: int
    used_height: int
    input_width: int
    input_height: int

    def to_image(self, box: np.ndarray) -> np.ndarray:
        """Boxes x1 y1 x2 y2 in px of the input -> float64 in px of the image, not clipped."""
        x, y = self.width / self.used_width, self.height / self.used_height
        return np.asarray(box, np.float64) * [x, y, x, y]


Preprocess = Callable[[np.ndarray], tuple[np.ndarray, Geometry]]


def preprocessor(spec: dict[str, Any], where: str) -> Preprocess:
    """The preprocessing that a card's `[input]` describes.

    resize : letterbox (aspect kept, padded right and below), stretch, shortest (the short side
        becomes `shortest` unless the long one would pass `longest`).
    size : [height, width] px for letterbox and stretch; pad : value of the padding, 0 to 255.
    multiple : both sides are stretched up to a multiple of it (shortest only).
    resample : opencv or pillow, bilinear; Pillow's also averages when it shrinks.
    colour : RGB or BGR.  layout : NCHW or NHWC.
    scale : factor on the 0 to 255 values; then `mean` is taken off and `std` divides, by channel
        in the order of `colour`.

    The result takes a uint8 image (h, w, 3), RGB, and gives a float32 tensor with a batch of 1 and
    its geometry. Raises RsaDataError when the description is not of this form, RowError for an
    image that becomes empty.
    """
    try:
        resize = _RESIZES[spec["resize"]](spec)
    except KeyError as error:
        raise RsaDataError(
            f"{where}: [input] expected resize, one of {', '.join(_RESIZES)}, with its size; "
            f"missing or unknown: {error}"
        ) from error
    for key, choices in _CHOICES.items():
        if spec.get(key, choices[0]) not in choices:
            raise RsaDataError(f"{where}: [input] {unknown(key, spec[key], choices)}")
    bgr, nhwc = spec.get("colour") == "BGR", spec.get("layout") == "NHWC"
    # (value * scale - mean) / std in one multiplication and one addition
    std = np.array(spec.get("std", [1.0] * 3), np.float64)
    factor = (spec.get("scale", 1.0) / std).astype(np.float32)
    offset = (-np.array(spec.get("mean", [0.0] * 3), np.float64) / std).astype(np.float32)
    plain = bool(np.all(factor == 1) and np.all(offset == 0))

    def prepare(image: np.ndarray) -> tuple[np.ndarray, Geometry]:
        pixels, geometry = resize(image)  # (h, w, 3)
        if bgr:
            pixels = pixels[:, :, ::-1]
        if not nhwc:
            pixels = pixels.transpose(2, 0, 1)  # (3, h, w)
        values = np.empty((1, *pixels.shape), np.float32)
        if plain:
            values[0] = pixels
        else:
            shape = (1, 1, 3) if nhwc else (3, 1, 1)
            np.multiply(pixels, factor.reshape(shape), out=values[0])
            values[0] += offset.reshape(shape)
        return values, geometry

    return prepare


_CHOICES = {
    "colour": ("RGB", "BGR"),
    "layout": ("NCHW", "NHWC"),
    "resample": ("opencv", "pillow"),
}


def _interpolate(image: np.ndarray, width: int, height: int, resample: str) -> np.ndarray:
    if image.shape[:2] == (height, width):
        return image
    if resample == "pillow":
        from PIL import Image

        how = Image.Resampling.BILINEAR
        return np.asarray(Image.fromarray(image).resize((width, height), how))
    import cv2

    return cv2.resize(image, (width, height), interpolation=cv2.INTER_LINEAR)


def _letterbox(spec: dict[str, Any]) -> Preprocess:
    height, width = spec["size"]
    resample, pad = spec.get("resample", "opencv"), spec.get("pad", 114)

    def resize(image: np.ndarray) -> tuple[np.ndarray, Geometry]:
        h, w = image.shape[:2]
        ratio = min(height / h, width / w)
        used_h, used_w = int(h * ratio), int(w * ratio)
        if not used_h or not used_w:
            raise RowError(f"image of {w} x {h} px: too narrow to be shown in {width} x {height}")
        canvas = np.full((height, width, 3), pad, np.uint8)
        canvas[:used_h, :used_w] = _interpolate(image, used_w, used_h, resample)
        return canvas, Geometry(w, h, used_w, used_h, width, height)

    return resize


def _stretch(spec: dict[str, Any]) -> Preprocess:
    height, width = spec["size"]
    resample = spec.get("resample", "opencv")

    def resize(image: np.ndarray) -> tuple[np.ndarray, Geometry]:
        h, w = image.shape[:2]
        pixels = _interpolate(image, width, height, resample)
        return pixels, Geometry(w, h, width, height, width, height)

    return resize


def _shortest(spec: dict[str, Any]) -> Preprocess:
    short, longest, multiple = spec["shortest"], spec["longest"], spec.get("multiple", 1)
    resample = spec.get("resample", "opencv")

    def resize(image: np.ndarray) -> tuple[np.ndarray, Geometry]:
        h, w = image.shape[:2]
        height, width = shortest_size(h, w, short, longest)
        height, width = (-(-side // multiple) * multiple for side in (height, width))
        if not height or not width:
            raise RowError(f"image of {w} x {h} px: too narrow, a side would become 0 px")
        pixels = _interpolate(image, width, height, resample)
        return pixels, Geometry(w, h, width, height, width, height)

    return resize


def shortest_size(height: int, width: int, short: int, longest: int) -> tuple[int, int]:
    """(height, width) with the short side `short`, or less, so that the long one is <= `longest`.

    Rounds as DETR's own transforms and transformers' get_size_with_aspect_ratio do: the limited
    short side is rounded, the long one cut off.
    """
    low, high = min(height, width), max(height, width)
    exact: float = short
    if high / low * short > longest:
        exact = longest * low / high
    side = round(exact)
    if low == side:
        return height, width
    other = int(exact * high / low)
    return (side, other) if height <= width else (other, side)


_RESIZES: dict[str, Callable[[dict[str, Any]], Preprocess]] = {
    "letterbox": _letterbox,
    "stretch": _stretch,
    "shortest": _shortest,
}
