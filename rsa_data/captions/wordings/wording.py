"""What a wording is, and the pieces that several of them are made of.

A wording is an entry of registry.STYLES, a `Wording` in a file of its own beside this one. Its
version is stored with the texts and raised with any change of wording, so that texts of two
versions are never taken for the same.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import pyarrow as pa

from ...common.errors import UsageError
from ..assemble import Column
from ..objects import Objects
from ..words import Word

NOTHING = "An image."


@dataclass(frozen=True)
class Wording:
    """One style.

    version : of the wording.
    example : a short text in this style, shown by `rsa-data list styles`.
    phrase : (objects, the words of their labels, digits of a percentage) -> the columns whose
        strings side by side are an object's phrase. Columns meet at spaces or at one sign, so
        that their tokens add up.
    opening : what stands before the objects, or samples -> that of each image.
    between, last : the sign between two phrases, and before the last one of several.
    closing : the end of a text that has objects.
    group : True when equal classes are always one object, False when never, None for a choice.
    """

    version: int
    example: str
    phrase: Callable[[Objects, Sequence[Word], int], list[Column]]
    opening: str | Callable[[pa.Table], list[str]] = "An image with "
    between: str = ", "
    last: str = ", "
    closing: str = ""
    group: bool | None = None

    def __post_init__(self) -> None:
        # What an entry of the registry documents itself with, as functions do.
        object.__setattr__(self, "__doc__", self.example)


@cache
def percentages(digits: int) -> tuple[str, ...]:
    """Every percentage from 0 to 100 with so many decimals: entry k is k / 10**digits."""
    one = 10**digits
    if not digits:
        return tuple(str(k) for k in range(101))
    return tuple(f"{k // one}.{k % one:0{digits}d}" for k in range(100 * one + 1))


def percentage(objects: Objects, digits: int) -> Column:
    """Each object's share of the image in percent."""
    return Column(percentages(digits), np.rint(objects.area * (100 * 10**digits)).astype(np.int64))


def named(objects: Objects, words: Sequence[Word], form: Callable[[Word, int], str]) -> Column:
    """Each object's class and count, the distinct pairs spelled by `form(word, count)`."""
    base = int(objects.count.max(initial=0)) + 1
    key = objects.label.astype(np.int64) * base + objects.count
    # Few classes and counts: a table of all pairs is cheaper than sorting for the distinct ones.
    present = np.bincount(key) > 0
    pairs = np.flatnonzero(present).tolist()
    strings = tuple(form(words[pair // base], pair % base) for pair in pairs)
    return Column(strings, (np.cumsum(present) - 1)[key])


def centers(objects: Objects, style: str) -> np.ndarray:
    """float32 of shape (objects, 2), px: where each object is. Raises UsageError without them."""
    if objects.center is None:
        raise UsageError(
            f"style {style!r} tells where things are, but these segments have no centers (an "
            "import of classes and shares has none). Use the style occupancy, or segments of a "
            "model or of masks: --segments NAME"
        )
    return objects.center
