"""Pixels as an image encoder wants them, by the settings that models of transformers carry."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..common.errors import RowError, RsaDataError

# openai/CLIP, clip/clip.py, _transform; the RN50 of the paper reads 224 x 224.
CLIP_RN50: Mapping[str, Any] = {
    "size": {"shortest_edge": 224},
    "crop_size": {"height": 224, "width": 224},
    "resample": 3,
    "image_mean": (0.48145466, 0.4578275, 0.40821073),
    "image_std": (0.26862954, 0.26130258, 0.27577711),
    "do_center_crop": True,
}

# Pixels of an image that was resized and is not cropped yet, 4 bytes each. Only images some hundred
# times as long as wide have more.
MOST_PIXELS = 100_000_000


def preparer(settings: Mapping[str, Any], where: str) -> Callable[[np.ndarray], np.ndarray]:
    """What makes an image into an encoder's input.

    settings : as in preprocessor_config.json: size and resample (Pillow's number), crop_size,
        rescale_factor, image_mean and image_std, each with its do_... switch.
    where : begins the message of an error.

    The result maps uint8 of shape (height, width, 3), RGB, to float32 of shape (3, height, width);
    it raises RowError for an image that would have more than MOST_PIXELS when it is resized.
    Raises RsaDataError for settings that are not known here.
    """
    from PIL import Image

    def on(name: str) -> bool:
        return bool(settings.get(name, True))

    if on("do_resize") and settings.get("do_pad"):
        raise RsaDataError(f"{where}: expected an encoder that crops or stretches; found do_pad")
    size = _size(settings.get("size"), where) if on("do_resize") else None
    crop = _size(settings.get("crop_size"), where) if settings.get("do_center_crop") else None
    if crop and len(crop) == 1:
        crop = (crop[0], crop[0])
    resample = Image.Resampling(int(settings.get("resample", 2)))
    factor = float(settings.get("rescale_factor", 1 / 255)) if on("do_rescale") else 1.0
    normal = on("do_normalize") and "image_mean" in settings
    mean = np.array(settings["image_mean"] if normal else [0.0] * 3, np.float32)
    deviation = np.array(settings["image_std"] if normal else [1.0] * 3, np.float32)

    def prepare(image: np.ndarray) -> np.ndarray:
        picture = Image.fromarray(image)
        if size:
            wanted = size[::-1] if len(size) == 2 else _shortest(picture.size, size[0])
            if wanted[0] * wanted[1] > MOST_PIXELS:
                raise RowError(
                    f"image of {picture.width} x {picture.height} px: too narrow; expected at most "
                    f"{MOST_PIXELS:,} px when its short side is {size[0]} px, found "
                    f"{wanted[0] * wanted[1]:,} px"
                )
            picture = picture.resize(wanted, resample)
        pixels = np.asarray(picture)
        if crop:
            pixels = _centre(pixels, *crop)
        scaled = (pixels.astype(np.float32) * np.float32(factor) - mean) / deviation
        return np.ascontiguousarray(scaled.transpose(2, 0, 1))

    return prepare


def _size(given: Any, where: str) -> tuple[int, ...]:
    """(height, width), or (shortest edge,), of the notations that configurations use."""
    if isinstance(given, int):
        return (given,)
    if isinstance(given, Mapping) and {"height", "width"} <= set(given):
        return int(given["height"]), int(given["width"])
    if isinstance(given, Mapping) and set(given) == {"shortest_edge"}:
        return (int(given["shortest_edge"]),)
    raise RsaDataError(
        f"{where}: expected size as height and width or shortest_edge, found {given}"
    )


def _shortest(size: tuple[int, int], edge: int) -> tuple[int, int]:
    """(width, height) with the shorter one at `edge`, as torchvision and transformers round it."""
    width, height = size
    short, long = min(size), max(size)
    other = int(edge * long / short)
    return (edge, other) if width <= height else (other, edge)


def _centre(pixels: np.ndarray, height: int, width: int) -> np.ndarray:
    """The middle of an image; what it lacks is filled with 0."""
    lack = [max(0, height - pixels.shape[0]), max(0, width - pixels.shape[1])]
    if any(lack):
        pixels = np.pad(pixels, [(n // 2, n - n // 2) for n in lack] + [(0, 0)])
    top, left = (pixels.shape[0] - height) // 2, (pixels.shape[1] - width) // 2
    return pixels[top : top + height, left : left + width]
