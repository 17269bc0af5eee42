"""From an image to what a model's card wants to see, and the way back for coordinates."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..common import forms
from ..common.errors import RowError, RsaDataError, unknown


@dataclass(frozen=True)
class Geometry:
    """How an image lies in the input tensor.

    width, height : px, of the image.
    used_width, used_height : px of the input that show the image; the rest is padding.
    input_width, input_height : px, of the input tensor.
    left, top : px of the input before the image.
    """

    width: int
    height: int
    used_width: int
    used_height: int
    input_width: int
    input_height: int
    left: int = 0
    top: int = 0

    @property
    def shown(self) -> tuple[float, float, float, float]:
        """Shares of the input's height and width that show the image, and that lie before it."""
        height, width = self.input_height, self.input_width
        return (
            self.used_height / height,
            self.used_width / width,
            self.top / height,
            self.left / width,
        )

    def to_image(self, box: np.ndarray) -> np.ndarray:
        """Boxes x1 y1 x2 y2 in px of the input -> float64 in px of the image, not clipped."""
        x, y = self.width / self.used_width, self.height / self.used_height
        before = np.tile([self.left, self.top], 2)
        return np.asarray((np.asarray(box, np.float64) - before) * [x, y, x, y])


Preprocess = Callable[[np.ndarray], tuple[np.ndarray, Geometry]]


def preprocessor(spec: dict[str, Any], where: str) -> Preprocess:
    """The preprocessing that a card's `[input]` describes.

    resize : letterbox (aspect kept, padded right and below), centred (letterbox, padded on both
        sides as Ultralytics does), stretch, shortest (the short side becomes `shortest` unless the
        long one would pass `longest`).
    size : [height, width] px for letterbox and stretch.
    multiple : both sides are stretched up to a multiple of it (shortest only).
    pad_multiple : both sides are padded to a multiple of it, right and below (shortest only).
    pad : value of the padding, 0 to 255; without it, padding is 0 in the tensor.
    resample : opencv or pillow, bilinear; Pillow's also averages when it shrinks.
    colour : RGB or BGR.  layout : NCHW or NHWC.
    scale : factor on the 0 to 255 values; then `mean` is taken off and `std` divides, by channel
        in the order of `colour`.

    The result takes a uint8 image (h, w, 3), RGB, and gives a float32 tensor with a batch of 1 and
    its geometry. Raises RsaDataError when the description is not of this form, RowError for an
    image that becomes empty.
    """
    forms.check(spec, _FORM, f"{where}: [input]")
    if 0 in spec.get("std", ()):
        raise RsaDataError(f"{where}: [input].std: expected numbers other than 0, found 0")
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
    if spec.get("resample", "opencv") == "opencv":
        import cv2  # noqa: F401  # here, so that the first image does not wait for it
    bgr, nhwc = spec.get("colour") == "BGR", spec.get("layout") == "NHWC"
    # (value * scale - mean) / std in one multiplication and one addition
    std = np.array(spec.get("std", [1.0] * 3), np.float64)
    factor = (spec.get("scale", 1.0) / std).astype(np.float32)
    offset = (-np.array(spec.get("mean", [0.0] * 3), np.float64) / std).astype(np.float32)
    padding = np.float32(spec["pad"]) * factor + offset if "pad" in spec else np.zeros(3)

    def prepare(image: np.ndarray) -> tuple[np.ndarray, Geometry]:
        pixels, geometry = resize(image)  # (h, w, 3), the part that is not padding
        if bgr:
            pixels = pixels[:, :, ::-1]
        values = np.empty((geometry.input_height, geometry.input_width, 3), np.float32)
        if not nhwc:
            values = np.empty((3, *values.shape[:2]), np.float32).transpose(1, 2, 0)
        top, left = geometry.top, geometry.left
        used = values[top : top + geometry.used_height, left : left + geometry.used_width]
        if used.shape != values.shape:
            values[:] = padding
        for channel in range(3):
            np.copyto(used[:, :, channel], pixels[:, :, channel])
            if factor[channel] != 1:
                used[:, :, channel] *= factor[channel]
            if offset[channel]:
                used[:, :, channel] += offset[channel]
        return (values if nhwc else values.transpose(2, 0, 1))[None], geometry

    return prepare


_FORM = {f"{key}?": "text" for key in ("name", "resize", "resample", "colour", "layout")}
_FORM |= {f"{key}?": "a side in px" for key in ("shortest", "longest", "multiple", "pad_multiple")}
_FORM |= {f"{key}?": "a list of 3 numbers" for key in ("mean", "std")}
_FORM |= {"size?": "two sides in px", "pad?": "a number", "scale?": "a number"}

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
    resample = spec.get("resample", "opencv")

    def resize(image: np.ndarray) -> tuple[np.ndarray, Geometry]:
        h, w = image.shape[:2]
        ratio = min(height / h, width / w)
        used_h, used_w = int(h * ratio), int(w * ratio)
        if not used_h or not used_w:
            raise RowError(f"image of {w} x {h} px: too narrow to be shown in {width} x {height}")
        pixels = _interpolate(image, used_w, used_h, resample)
        return pixels, Geometry(w, h, used_w, used_h, width, height)

    return resize


def _centred(spec: dict[str, Any]) -> Preprocess:
    """As Ultralytics' LetterBox rounds: sides to the nearest pixel, half a pixel up and left."""
    height, width = spec["size"]
    resample = spec.get("resample", "opencv")

    def resize(image: np.ndarray) -> tuple[np.ndarray, Geometry]:
        h, w = image.shape[:2]
        ratio = min(height / h, width / w)
        used_h, used_w = max(1, round(h * ratio)), max(1, round(w * ratio))
        top, left = round((height - used_h) / 2 - 0.1), round((width - used_w) / 2 - 0.1)
        pixels = _interpolate(image, used_w, used_h, resample)
        return pixels, Geometry(w, h, used_w, used_h, width, height, left, top)

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
    short, longest = spec["shortest"], spec["longest"]
    multiple, pad_multiple = spec.get("multiple", 1), spec.get("pad_multiple", 1)
    resample = spec.get("resample", "opencv")

    def resize(image: np.ndarray) -> tuple[np.ndarray, Geometry]:
        h, w = image.shape[:2]
        height, width = shortest_size(h, w, short, longest)
        height, width = (-(-side // multiple) * multiple for side in (height, width))
        if not height or not width:
            raise RowError(f"image of {w} x {h} px: too narrow, a side would become 0 px")
        pixels = _interpolate(image, width, height, resample)
        full_h, full_w = (-(-side // pad_multiple) * pad_multiple for side in (height, width))
        return pixels, Geometry(w, h, width, height, full_w, full_h)

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
    "centred": _centred,
    "stretch": _stretch,
    "shortest": _shortest,
}
