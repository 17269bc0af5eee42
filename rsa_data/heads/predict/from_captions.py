"""What a head says of captions: scale, shift, their spread, and whether it knows such captions."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ..belong import encode
from ..checkpoint import ScaleHead
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
    """Predictions of captions, each with the spread over its paraphrases and its distance.

    encoder : the head's encoder, when the caller holds it in memory. style : of the captions, where
    it is not that of the head's training captions.
    """
    # Each text once: the place in a batch may change the last bit.
    distinct = list(dict.fromkeys(captions))
    wording = wording_of(head.description, style)
    orders = [paraphrases(text, wording) for text in distinct]
    others = [found or [] for found in orders]
    flat = [text for pair in zip(distinct, others, strict=True) for text in (pair[0], *pair[1])]
    features = encoder(flat) if encoder else encode(head.description["features"], flat, weights)
    scale, shift = head(features)
    starts = np.cumsum([0] + [1 + len(o) for o in others])
    far = head.description.get("far")
    unlike = np.zeros(len(flat), bool)
    if far is not None and head.reference is not None:
        unlike = distance(features, head.reference, head.mean.numpy()) > far
    found = {}
    for text, order, start, end in zip(distinct, orders, starts[:-1], starts[1:], strict=True):
        a, b = scale[start:end], shift[start:end]
        spread = (float(a.min()), float(a.max()), float(b.min()), float(b.max()))
        found[text] = Prediction(
            text,
            float(a[0]),
            float(b[0]),
            spread=spread if len(a) > 1 else None,
            unlike=bool(unlike[start]),
            notes=[_NO_SPREAD] if order is None else [],
        )
    return [found[text].copy() for text in captions]
