"""The styles `occupied` and `occupied-share`: the paper's wording, in percent and as a share."""

from collections.abc import Sequence
from functools import cache

from ..assemble import Column
from ..objects import Objects
from ..words import Word
from .wording import Wording, named, percentage


@cache
def _rounded(digits: int, whole: int) -> tuple[str, ...]:
    """Every share of `whole` in steps of 1 / 10**digits, as str(round(share, digits)) writes it."""
    # As the released code: 30.1, not 30.10.
    scale = 10**digits
    return tuple(str(k / scale) if digits else str(k) for k in range(whole * scale + 1))


def _occupied(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    return [
        named(objects, words, lambda w, n: f"{w.name} occupied "),
        Column(_rounded(digits, 100), percentage(objects, digits).codes),
        Column(("% of image",)),
    ]


def _occupied_share(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    # Two decimals more are as fine as those of a percentage.
    return [
        named(objects, words, lambda w, n: f"{w.name} occupied "),
        Column(_rounded(digits + 2, 1), percentage(objects, digits).codes),
        Column((" of image",)),
    ]


occupied = Wording(
    1,
    "An image with bed occupied 13.42% of image. As the released code wrote it",
    _occupied,
    closing=".",
    group=False,
)

occupied_share = Wording(
    1,
    "An image with bed occupied 0.1342 of image. As the paper writes it",
    _occupied_share,
    closing=".",
    group=False,
)
