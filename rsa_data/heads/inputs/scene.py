"""What a head is told of one image that is in no table, and how its features are made from it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np


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


def _text_files(options: dict[str, Any], weights: Path | None) -> dict[str, Path]:
    from ...embeddings import embed

    return embed.files(**{**options, "encoder_weights": weights})


def _text_encoder(
    options: dict[str, Any], weights: Path | None
) -> Callable[[Sequence[str]], np.ndarray]:
    from ...embeddings import embed

    return embed.loaded(**{**options, "encoder_weights": weights})


def _texts(options: dict[str, Any], weights: Path | None) -> Maker:
    encode = _text_encoder(options, weights)
    return lambda scenes: encode(
        [scene.text if scene.text is not None else "An image." for scene in scenes]
    )


def _image_files(options: dict[str, Any], weights: Path | None) -> dict[str, Path]:
    from ...embeddings import embed_images

    return embed_images.files(encoder=options["encoder"], encoder_weights=weights)


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


def _objects(options: dict[str, Any], weights: Path | None) -> Maker:
    from .objects import Objects, numbers

    encode = _text_encoder(options, weights)
    known: dict[str, np.ndarray] = {}

    def make(scenes: Sequence[Scene]) -> np.ndarray:
        things = [thing for scene in scenes for thing in scene.things or ()]
        names = list(dict.fromkeys(thing.name for thing in things))
        for name in names:
            if name not in known:
                known[name] = encode([name])[0].astype(np.float32)  # alone, as embed-objects does
        features = [known[name] for name in names]
        counts = [len(scene.things or ()) for scene in scenes]
        shares = np.array([np.nan if t.share is None else t.share for t in things], np.float64)
        places = np.array([t.center or (np.nan, np.nan) for t in things], np.float64)
        about = numbers(shares, places.reshape(-1, 2), np.array([t.is_thing for t in things], bool))
        return Objects(
            np.stack(features) if names else np.zeros((0, 0), np.float32),
            np.array([names.index(thing.name) for thing in things], np.int64),
            about,
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            np.ones(len(scenes), bool),
        ).rows(np.arange(len(scenes)), np.zeros(len(scenes)))

    return make


TEXT = Live(_text_files, _texts)
IMAGE = Live(_image_files, _images)
OBJECTS = Live(_text_files, _objects)
