"""A validation split carved out of the training images, never out of a test split."""

import hashlib

import numpy as np

from ...common.errors import UsageError

# Enough to choose an epoch by; more would cost time and memory at every epoch for nothing.
MOST = 2000


def by_scene(dataset: str, scene: np.ndarray, share: float, block: bool) -> tuple[np.ndarray, str]:
    """Which images are for validation, bool (n,), and how that was decided, for head.json.

    scene : n names. Whole scenes are taken, in the order of a hash of their names, until `share`
    of the images (2,000 at most) is reached; at least one scene stays for training.
    block : with one scene only, take the last frames of the dataset's order as one block, the
    neighbours of training frames. Without it one scene is refused with UsageError.
    """
    names = sorted(set(scene))
    wanted = min(MOST, max(1, round(share * len(scene))))
    if len(names) > 1:
        names.sort(key=lambda name: hashlib.sha256(f"{dataset}\0{name}".encode()).digest())
        taken: list[str] = []
        while len(taken) < len(names) - 1 and np.isin(scene, taken).sum() < wanted:
            taken.append(names[len(taken)])
        return np.isin(scene, taken), f"{len(taken)} of {len(names)} scenes"
    if not block:
        raise UsageError(
            f"{dataset}: all {len(scene)} training images are of one scene, {names[0]!r}: no scene "
            "can be held out to choose the best epoch by (with test_share, three folders of images "
            "are needed). --split-scene takes the last frames as a "
            "block instead, and says so in head.json: they look like the training frames, so the "
            "validation error is too good"
        )
    chosen = np.arange(len(scene)) >= len(scene) - wanted
    return chosen, "the last frames of the only scene, one block (--split-scene): too good"
