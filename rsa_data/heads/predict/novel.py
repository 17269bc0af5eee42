"""Which objects a head that reads objects has never seen in training."""

from collections.abc import Callable, Sequence

import numpy as np

from ..checkpoint import ScaleHead
from ..inputs.objects import NUMBERS
from ..inputs.scene import Scene, Thing
from .calibration import distance

# Features of one name differ by less than this, whatever precision made them; those of two names
# by far more.
_SAME = 1e-3


def unseen(
    head: ScaleHead, read: Callable[[Sequence[Scene]], np.ndarray], things: Sequence[Thing]
) -> list[str] | None:
    """Names of things that were in no training image, or None where the head does not say.

    read : a `Reading` of the head.
    """
    if head.reference is None:
        return None
    names = list(dict.fromkeys(thing.name for thing in things))
    if not names:
        return []
    rows = read([Scene(things=(Thing(name, None, None, True),)) for name in names])
    width = -len(NUMBERS)
    far = distance(rows[:, :width], head.reference[:, :width], np.zeros(1, np.float32))
    return [name for name, apart in zip(names, far, strict=True) if apart > _SAME]
