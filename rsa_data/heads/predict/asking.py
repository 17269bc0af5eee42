"""A head with its encoders in memory, asked about photos and captions."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...common.errors import UsageError
from ..checkpoint import ScaleHead
from ..inputs.scene import Scene
from ..reading import Reading
from .from_captions import from_scenes
from .nouns import objects_in, text_of
from .objects import things
from .prediction import Prediction

if TYPE_CHECKING:
    from ...segments.segments import Segments


class Asking:
    """A head and what it reads.

    weights : file of its encoder, where it is not found by itself. style : of the captions, where
    it is not that of the head's training captions. kinds : of input that the head reads.

    Raises as `Reading` does.
    """

    def __init__(self, head: ScaleHead, weights: Path | None = None, style: str | None = None):
        self.head, self.style = head, style
        self.read = Reading(head.about.features, weights)
        self.kinds = self.read.kinds

    def __call__(
        self,
        text: str | None,
        segments: "Segments | None" = None,
        image: np.ndarray | None = None,
        spread: bool = True,
    ) -> Prediction:
        """What the head says of a caption, of the objects found and of the photo.

        text : the caption. segments : the objects found in the photo; None: those that the caption
        names. image : uint8 (h, w, 3), RGB. What the head does not read may be None. spread : see
        `from_scenes`.
        Raises UsageError where the head reads the photo and there is none.
        """
        if "image" in self.kinds and image is None:
            raise UsageError("this head reads the photo itself: give one")
        notes, warnings, found = [], [], None
        if "objects" in self.kinds and segments is not None:
            found = things(segments)
        elif "objects" in self.kinds:
            found, rest = objects_in(text or "")
            notes.append(f"objects read: {text_of(found) or 'none'}")
            notes += [f"not read as objects: {'; '.join(rest)}"] if rest else []
            warnings += [] if found else ["the caption names no object"]
        scene = Scene(
            text if "text" in self.kinds else None,
            found,
            image if "image" in self.kinds else None,
        )
        (p,) = from_scenes(self.head, [scene], self.read, self.style, spread)
        p.caption = text
        p.notes += notes
        p.warnings += warnings
        if self.head.about.only_synthetic:
            p.warnings.append("the head was trained on synthetic scenes only; photos are not those")
        return p
