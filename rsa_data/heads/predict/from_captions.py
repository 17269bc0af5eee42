"""What a head says of captions and scenes: scale, shift, their spread, whether it knows them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...common import bounded
from ..checkpoint import ScaleHead
from ..inputs.scene import Scene
from ..reading import Reading
from .calibration import distance
from .paraphrases import paraphrases, wording_of
from .prediction import Prediction

# What is said of a caption whose objects nobody can tell apart.
_NO_SPREAD = "no spread over paraphrases: it is not known which words of this caption are objects"


def from_captions(
    head: ScaleHead,
    captions: Sequence[str],
    weights: Path | None = None,
    encoder: Callable[[Sequence[str]], np.ndarray] | None = None,
    style: str | None = None,
) -> list[Prediction]:
    """Predictions of captions by a head that reads nothing else, as `from_scenes`.

    encoder : the head's encoder, when the caller holds it in memory.
    """
    read: Callable[[Sequence[Scene]], np.ndarray]
    if encoder is None:
        read = Reading(head.about.features, weights)
    else:
        own = encoder

        def read(scenes: Sequence[Scene]) -> np.ndarray:
            return own([scene.text or "" for scene in scenes])

    return from_scenes(head, [Scene(text=text) for text in captions], read, style)


def from_scenes(
    head: ScaleHead,
    scenes: Sequence[Scene],
    read: Callable[[Sequence[Scene]], np.ndarray],
    style: str | None = None,
    spread: bool = True,
) -> list[Prediction]:
    """Predictions of scenes, each with the spread over its caption's paraphrases and its distance.

    read : a `Reading` of the head. style : of the captions, where it is not that of the head's
    training captions. spread : false where an answer at once matters more.
    """
    keys = [(scene.text, scene.things, id(scene.image)) for scene in scenes]
    # Each scene once: the place in a batch may change the last bit.
    distinct = dict(zip(keys, scenes, strict=True))
    bounded.check_captions((s.text for s in distinct.values() if s.text is not None), "predict")
    wording = wording_of(head.description, style)
    orders = [
        paraphrases(s.text, wording) if spread and s.text is not None else []
        for s in distinct.values()
    ]
    flat = [
        scene
        for own, order in zip(distinct.values(), orders, strict=True)
        for scene in (own, *(replace(own, text=text) for text in order or ()))
    ]
    features = read(flat)
    scale, shift = head(features)
    starts = np.cumsum([0] + [1 + len(order or ()) for order in orders])
    far = head.description.get("far")
    unlike = np.zeros(len(flat), bool)
    if far is not None and head.reference is not None:
        unlike = distance(features, head.reference, head.mean.numpy()) > far
    found = {}
    for key, order, start, end in zip(distinct, orders, starts[:-1], starts[1:], strict=True):
        a, b = scale[start:end], shift[start:end]
        ends = (float(a.min()), float(a.max()), float(b.min()), float(b.max()))
        found[key] = Prediction(
            key[0],
            float(a[0]),
            float(b[0]),
            spread=ends if len(a) > 1 else None,
            unlike=bool(unlike[start]),
            notes=[_NO_SPREAD] if order is None else [],
        )
    return [found[key].copy() for key in keys]
