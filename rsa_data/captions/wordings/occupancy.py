"""The style `occupancy`: which share of the image each object covers; the default."""

from collections.abc import Sequence

from ..assemble import Column
from ..objects import Objects
from ..words import Word
from .wording import Wording, named, percentage


def phrase(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    """`bed occupies 13.42% of the image`, `2 chairs occupy 8.00% of the image`."""

    def head(w: Word, n: int) -> str:
        several = w.name if n == 1 else f"{n} {w.plural}"
        return several + (" occupy " if n > 1 or w.is_plural else " occupies ")

    return [
        named(objects, words, head),
        percentage(objects, digits),
        Column(("% of the image",)),
    ]


occupancy = Wording(1, "An image with bed occupies 13.42% of the image, wall occupies ...", phrase)
