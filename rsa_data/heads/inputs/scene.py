"""What a head is told of one image that is in no table, and how its features are made from it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...common import own_code
from ...common.entries import Entries
from ...registry import ENCODERS, IMAGE_ENCODERS


class Thing(NamedTuple):
    """An object of an image.

    name : class name as captions write it. share : of the image, 0 to 1, or None where it is not
    known. center : x and y in shares of width and height, or None. is_thing : countable.
    """

    name: str
    share: float | None
    center: tuple[float, float] | None
    is_thing: bool


@dataclass(frozen=True, eq=False)
class Scene:
    """An image, as far as it is known.

    text : its caption. things : its objects. image : uint8 (h, w, 3), RGB.
    """

    text: str | None = None
    things: tuple[Thing, ...] | None = None
    image: np.ndarray | None = None


Maker = Callable[[Sequence[Scene]], np.ndarray]
"""Scenes -> the rows of features of one input, float32 (n, width)."""


@dataclass(frozen=True)
class Live:
    """How the features of one input are made for scenes that are in no table.

    files : (options of the encoder, the user's weights) -> the files whose bytes decide the
        features, by name; may download them.
    load : (the same) -> Maker, with the encoder in memory.
    """

    files: Callable[[dict[str, Any], Path | None], dict[str, Path]]
    load: Callable[[dict[str, Any], Path | None], Maker]


def text_files(options: dict[str, Any], weights: Path | None) -> dict[str, Path]:
    """The files of a text encoder, its module too where it is not this package's; may download
    them."""
    from ...embeddings import frozen

    return frozen.files(**{**options, "encoder_weights": weights}) | _code(ENCODERS, options)


def _code(encoders: Entries, options: dict[str, Any]) -> dict[str, Path]:
    module = encoders.module(encoders.split(str(options["encoder"]))[0])
    return {"code": own_code.source_file(module)} if module else {}


def text_encoder(
    options: dict[str, Any], weights: Path | None
) -> Callable[[Sequence[str]], np.ndarray]:
    """Texts -> features, float32 (n, dim), with the encoder in memory."""
    from ...embeddings import frozen

    return frozen.loaded(**{**options, "encoder_weights": weights})


def _texts(options: dict[str, Any], weights: Path | None) -> Maker:
    encode = text_encoder(options, weights)
    return lambda scenes: encode(
        [scene.text if scene.text is not None else "An image." for scene in scenes]
    )


def _image_files(options: dict[str, Any], weights: Path | None) -> dict[str, Path]:
    from ...embeddings import embed_images

    found = embed_images.files(encoder=options["encoder"], encoder_weights=weights)
    return found | _code(IMAGE_ENCODERS, options)


def _images(options: dict[str, Any], weights: Path | None) -> Maker:
    from ...embeddings import embed_images

    encode = embed_images.loaded(encoder=options["encoder"], encoder_weights=weights)
    stored = options.get("store", "float16")

    def make(scenes: Sequence[Scene]) -> np.ndarray:
        images = {id(s.image): s.image for s in scenes if s.image is not None}
        # Each image alone and once: its place in a batch could change the last bits.
        found = {key: encode([image])[0] for key, image in images.items()}
        rows = np.stack([found[id(scene.image)] for scene in scenes])
        return rows.astype(stored).astype(np.float32)

    return make


TEXT = Live(text_files, _texts)
IMAGE = Live(_image_files, _images)
