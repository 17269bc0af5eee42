"""The style `occupied`: shares of the image as the released code wrote them."""

from collections.abc import Sequence
from functools import cache

from ..assemble import Column
from ..objects import Objects
from ..words import Word
from .wording import Wording, named, percentage


@cache
def _rounded(digits: int) -> tuple[str, ...]:
    # str(round(100 * share, 2)) of the released code: 30.1, not 30.10.
    scale = 10**digits
    return tuple(str(k / scale) if digits else str(k) for k in range(100 * scale + 1))


def _occupied(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    codes = percentage(objects, digits).codes
    return [
        named(objects, words, lambda w, n: f"{w.name} occupied "),
        Column(_rounded(digits), codes),
        Column(("% of image",)),
    ]


occupied = Wording(
    1,
    "An image with bed occupied 13.42% of image. As the released code wrote it",
    _occupied,
    closing=".",
    group=False,
)
