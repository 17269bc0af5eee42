"""Relative depth from an ONNX model, by its card: what it wants to see and what it answers."""

import re
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..common.cards import Card
from ..common.errors import RowError, RsaDataError, UsageError
from ..common.model_files import local_file
from ..common.onnx_sessions import Device, open_session
from ..datasets import images
from ..datasets.kitti import CROP
from ..datasets.shards import name_of
from .card import card_for
from .files import inverse
from .model import Relative, Source


def build(
    *,
    name: str,
    root: Path,
    weights: Path | None,
    card: Path | None = None,
    geometry: str | None,
    crop: str,
    threads: int,
    device: Device = "auto",
    **_: Any,
) -> Source:
    """A session on the model's file, and the reader of images below `root`; see measure.build."""
    described = card_for(name, card)
    settings = described.settings
    session = open_session(local_file(described, weights, "--depth-weights"), threads, device)
    resize = fixed(geometry) if geometry else RESIZES[settings["resize"]](settings)
    first = session.get_inputs()[0]
    name_in, half = first.name, first.type == "tensor(float16)"
    wanted = _output_name(session, described)
    # Images are read side by side; the model runs on `threads` cores, as it was told.
    alone = threading.Lock()

    def source(path: str) -> Relative:
        try:
            image = images.read_image(root / path)
            turn = images.image_frame(root / path)[2]
            box = kb_box(*image.shape[:2]) if crop == "kb" else (0, 0, 1, 1)
            seen, part = resize(cut(image, box))
        except RowError as error:
            raise RowError(f"{name_of(path)}: {error}") from error
        pixels = normalise(seen, settings)
        if half:
            pixels = pixels.astype(np.float16)
        with alone:
            y = answer(session, name_in, pixels, name, wanted)
        y = inverse(y) if settings["output"] == "depth" else y
        size = image.shape[1], image.shape[0]
        return Relative(y, inside(box, part), size, turn)

    return source


def _output_name(session: Any, card: Card) -> str:
    """The output of a graph that is the map: the one that the card names, or the only one."""
    there = [output.name for output in session.get_outputs()]
    name: str = card.settings.get("output_name", there[0])
    if name not in there or (len(there) > 1 and "output_name" not in card.settings):
        raise RsaDataError(
            f"model card {card.name}: expected output_name, one of the file's outputs "
            f"{', '.join(there)}; found {card.settings.get('output_name', 'none')}"
        )
    return name


def model_file(name: str, weights: Path | None, card: Path | None = None) -> Path:
    """The weights given, or the card's file: from the cache, downloaded and checked if need be."""
    return local_file(card_for(name, card), weights, "--depth-weights")


def answer(
    session: Any, name_in: str, pixels: np.ndarray, model: str, output_name: str
) -> np.ndarray:
    """What a session says of one image's pixels: float32 of shape (height, width).

    Raises RsaDataError when the file cannot be of this model: it takes or gives another shape.
    """
    try:
        output = np.asarray(session.run([output_name], {name_in: pixels})[0])
    # onnxruntime's errors have no common base but Exception.
    except Exception as error:
        reason = " ".join(str(error).split())[:300]
        raise RsaDataError(
            f"depth model {model}: expected a file that takes {pixels.shape[3]}x{pixels.shape[2]} "
            f"px; found: {reason}. Is --depth-weights the file of this model, and does it take "
            "images of --geometry?"
        ) from error
    shape = output.shape[-2:] if output.ndim >= 2 else (0, 0)
    stretched = np.divide(shape, pixels.shape[2:])
    # A map of depth may be smaller than the image, but has its shape.
    if output.size != np.prod(shape) or not 0.8 < stretched[0] / max(stretched[1], 1e-9) < 1.25:
        raise RsaDataError(
            f"depth model {model}: expected one map of depth; found an output of shape "
            f"{output.shape}. Is --depth-weights the file of this model?"
        )
    if output.dtype.kind not in "fiu":
        raise RsaDataError(
            f"depth model {model}: expected numbers; found an output of {output.dtype}. Is "
            "--depth-weights the file of this model?"
        )
    found: np.ndarray = output.astype(np.float32).reshape(output.shape[-2:])
    if not np.isfinite(found).any():
        raise RowError(f"depth model {model}: expected numbers; found none that is finite")
    return found


Box = tuple[float, float, float, float]
# What a card says beyond the keys that all cards have.
Settings = dict[str, Any]
# RGB uint8 (h, w, 3) -> what the model sees, same layout, and the part of the image it shows.
Resize = Callable[[np.ndarray], tuple[np.ndarray, Box]]


def fixed(geometry: str) -> Resize:
    """Squashes every image to WIDTHxHEIGHT, bicubic, as the released code does (434x560 high)."""
    match = re.fullmatch(r"(\d+)x(\d+)", geometry)
    if not match or not int(match[1]) * int(match[2]):
        raise UsageError(
            f"geometry: expected WIDTHxHEIGHT in px such as 560x434, found {geometry!r}"
        )
    size = int(match[1]), int(match[2])
    return lambda image: (_resize(image, *size), (0.0, 0.0, 1.0, 1.0))


def _squash(card: Settings) -> Resize:
    """The card's `width` and `height`, whatever the image's shape."""
    return fixed(f"{card['width']}x{card['height']}")


def _keep_aspect(card: Settings) -> Resize:
    """The side that needs the least change becomes `size`, both are rounded to `multiple`.

    As DPTImageProcessor of transformers (keep_aspect_ratio) and Depth Anything do it.
    """

    def resize(image: np.ndarray) -> tuple[np.ndarray, Box]:
        height, width = image.shape[:2]
        size, multiple = card["size"], card["multiple"]
        k = min(size / height, size / width, key=lambda k: abs(1 - k))
        sides = [max(1, round(k * side / multiple)) * multiple for side in (width, height)]
        return _resize(image, *sides), (0.0, 0.0, 1.0, 1.0)

    return resize


def _centre_crop(card: Settings) -> Resize:
    """The short side becomes `short`, then the centred square of `size` is cut out."""

    def resize(image: np.ndarray) -> tuple[np.ndarray, Box]:
        height, width = image.shape[:2]
        k = card["short"] / min(height, width)
        height, width = round(height * k), round(width * k)
        size = card["size"]
        y0, x0 = (height - size) // 2, (width - size) // 2
        seen = _resize(image, width, height, area=k < 1)[y0 : y0 + size, x0 : x0 + size]
        return seen, (x0 / width, y0 / height, (x0 + size) / width, (y0 + size) / height)

    return resize


RESIZES: dict[str, Callable[[Settings], Resize]] = {
    "squash": _squash,
    "keep-aspect": _keep_aspect,
    "centre-crop": _centre_crop,
}


def _resize(image: np.ndarray, width: int, height: int, area: bool = False) -> np.ndarray:
    import cv2

    if image.shape[:2] == (height, width):
        return image
    how = cv2.INTER_AREA if area else cv2.INTER_CUBIC
    return cv2.resize(image, (width, height), interpolation=how)


def normalise(image: np.ndarray, card: Settings) -> np.ndarray:
    """RGB uint8 (h, w, 3) -> float32 (1, 3, h, w): / 255, minus the card's mean, over its std."""
    mean = np.float32(card.get("mean", (0,) * 3))
    std = np.float32(card.get("std", (1,) * 3))
    values = (image.astype(np.float32) / np.float32(255) - mean) / std  # (h, w, 3)
    return np.ascontiguousarray(values.transpose(2, 0, 1)[None])  # (1, 3, h, w)


def kb_box(height: int, width: int) -> Box:
    """KITTI's crop of BTS, bottom centre, as fractions of the image; RowError for a smaller one."""
    h, w = CROP
    if height < h or width < w:
        raise RowError(f"crop kb: expected at least {w}x{h} px, found {width}x{height}")
    left = (width - w) // 2
    return left / width, (height - h) / height, (left + w) / width, 1.0


def cut(image: np.ndarray, box: Box) -> np.ndarray:
    """The part of an image inside `box` (fractions of its width and height)."""
    height, width = image.shape[:2]
    x0, y0, x1, y1 = np.round(np.multiply(box, (width, height, width, height))).astype(int)
    return image[y0:y1, x0:x1]


def inside(outer: Box, inner: Box) -> Box:
    """`inner`, a part of the cut-out `outer`, as a part of the whole image."""
    x0, y0, width, height = outer[0], outer[1], outer[2] - outer[0], outer[3] - outer[1]
    return (
        x0 + inner[0] * width,
        y0 + inner[1] * height,
        x0 + inner[2] * width,
        y0 + inner[3] * height,
    )
