"""The style `counts`: how many of each class there are."""

from collections.abc import Sequence

from ..assemble import Column
from ..objects import Objects
from ..words import Word
from .wording import Wording, named


def _counts(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    return [named(objects, words, lambda w, n: f"{n} {w.name if n == 1 else w.plural}")]


counts = Wording(1, "An image with 1 bed, 1 wall, 2 chairs", _counts, group=True)
