"""What a head says of captions: scale, shift, their spread, and whether it knows such captions."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ..belong import encode
from ..checkpoint import ScaleHead
from .calibration import distance
from .images import paraphrases
from .prediction import Prediction


def from_captions(
    head: ScaleHead,
    captions: Sequence[str],
    weights: Path | None = None,
    encoder: Callable[[Sequence[str]], np.ndarray] | None = None,
) -> list[Prediction]:
    """Predictions of captions, each with the spread over its paraphrases and its distance.

    encoder : the head's encoder, when the caller holds it in memory.
    """
    # Each text once: the place in a batch may change the last bit.
    distinct = list(dict.fromkeys(captions))
    others = [paraphrases(text) for text in distinct]
    flat = [text for pair in zip(distinct, others, strict=True) for text in (pair[0], *pair[1])]
    features = encoder(flat) if encoder else encode(head.description["features"], flat, weights)
    scale, shift = head(features)
    starts = np.cumsum([0] + [1 + len(o) for o in others])
    far = head.description.get("far")
    unlike = np.zeros(len(flat), bool)
    if far is not None and head.reference is not None:
        unlike = distance(features, head.reference, head.mean.numpy()) > far
    found = {}
    for text, start, end in zip(distinct, starts[:-1], starts[1:], strict=True):
        a, b = scale[start:end], shift[start:end]
        spread = (float(a.min()), float(a.max()), float(b.min()), float(b.max()))
        found[text] = Prediction(
            text,
            float(a[0]),
            float(b[0]),
            spread=spread if len(a) > 1 else None,
            unlike=bool(unlike[start]),
        )
    return [found[text].copy() for text in captions]
