"""A head with its encoders in memory, asked about photos and captions."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...common import bounded
from ...common.errors import UsageError
from ..checkpoint import ScaleHead
from ..inputs.scene import Scene, Thing
from ..reading import Reading
from .from_captions import from_scenes
from .nouns import objects_in
from .novel import unseen
from .objects import things
from .prediction import NOTHING_FOUND, Prediction

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
        Raises UsageError where the head reads the photo and there is none, RsaDataError for a text
        that is too long.
        """
        bounded.check_captions([text] if text is not None else [], "predict")
        if "image" in self.kinds and image is None:
            raise UsageError("this head reads the photo itself: give one")
        notes, warnings, found = [], [], None
        if segments is not None:
            found = things(segments)
        elif text is not None and self.kinds != ("image",):
            caption = objects_in(text)
            found = caption.things
            notes += caption.notes
            if len(caption.strange) == len({thing.name for thing in found}):
                warnings.append("the caption names no object that a class table has")
        elif text is not None:
            notes.append("this head reads the photo alone: the caption makes no difference")
        scene = Scene(
            text if "text" in self.kinds else None,
            found if "objects" in self.kinds else None,
            image if "image" in self.kinds else None,
        )
        (p,) = from_scenes(self.head, [scene], self.read, self.style, spread)
        p.caption, p.words = text, (p.scale, p.shift)
        if segments is not None and not found and "image" not in self.kinds:
            p.unlike = False  # nothing is known, which is another thing
            warnings.append(NOTHING_FOUND)
        if found and self.kinds == ("objects",):
            self._compare(p, found)
        p.notes += notes
        p.warnings += warnings
        if self.head.about.only_synthetic:
            p.warnings.append("the head was trained on synthetic scenes only; photos are not those")
        return p

    def _compare(self, p: Prediction, found: Sequence[Thing]) -> None:
        """Says which objects were in no training image."""
        novel = unseen(self.head, self.read, found)
        if novel is None:
            p.notes.append("which objects this head was trained on is not known; train it again")
        elif novel:
            count = len({thing.name for thing in found})
            p.unlike = len(novel) == count
            p.warnings.append(
                f"in no image that the head was trained on: {', '.join(novel)}"
                + ("" if p.unlike else f" ({len(novel)} of {count} classes)")
            )
