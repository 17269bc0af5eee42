"""The style `classes`: which classes are there, plural for several."""

from collections.abc import Sequence

from ..assemble import Column
from ..objects import Objects
from ..words import Word
from .wording import Wording, named


def _classes(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    return [named(objects, words, lambda w, n: w.name if n == 1 else w.plural)]


classes = Wording(1, "An image with bed, wall, chair, chair", _classes)
