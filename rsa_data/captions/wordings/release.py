"""The style `release`: as the structured texts of the release."""

from collections.abc import Sequence

from ..assemble import Column
from ..objects import Objects
from ..words import Word, number_word
from .wording import Wording, named


def _release(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    def form(w: Word, n: int) -> str:
        return w.article + w.name if n == 1 else f"{number_word(n)} {w.plural}"

    return [named(objects, words, form)]


release = Wording(
    1,
    "An image with a bed, a wall, and two chairs. As the release's structured texts",
    _release,
    last=", and ",
    closing=".",
    group=True,
)
