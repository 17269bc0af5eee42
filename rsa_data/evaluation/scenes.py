"""One description for a whole scene, in place of one for each image."""

from collections.abc import Callable, Sequence

import numpy as np

from ..heads.belong import Source
from .inputs import TestPart


def one_description(parts: Sequence[TestPart], source: Source) -> Callable[..., np.ndarray] | None:
    """What gives every image of a scene the feature of its scene's first described image.

    Returns `see` for methods.by_head, or None where no scene has two images with a caption.
    """
    first: dict[str, np.ndarray] = {}
    several = False
    scenes: dict[int, list[str]] = {}
    for part in parts:
        features, there = part.seen(source)
        scenes[part.number] = [sample["scene"] for sample in part.samples]
        for scene, feature, has in zip(scenes[part.number], features, there, strict=True):
            several |= bool(has) and scene in first
            if has:
                first.setdefault(scene, feature)
    if not several:
        return None

    def see(features: np.ndarray, there: np.ndarray, part: int) -> np.ndarray:
        shared = features.copy()
        for row in np.flatnonzero(there):
            shared[row] = first[scenes[part][row]]
        return shared

    return see
