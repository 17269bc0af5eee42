"""Wordings: how each style says what an image shows.

A style is a `Wording`, an entry of registry.STYLES. Its version is stored with the texts and goes
up with any change of wording, so that texts of two versions are never taken for the same.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .assemble import Column
from .objects import Objects
from .words import Word


@dataclass(frozen=True)
class Wording:
    """One style.

    version : of the wording.
    phrase : (objects, the words of their labels, digits of a percentage) -> the columns whose
        strings side by side are an object's phrase. Columns meet at spaces and punctuation only,
        so that their tokens add up.
    between, last : the sign between two phrases, and before the last one of several.
    closing : the end of a text that has objects.
    group : True when equal classes are always one object, False when never, None for a choice.
    """

    version: int
    phrase: Callable[[Objects, Sequence[Word], int], list[Column]]
    between: str = ", "
    last: str = ", "
    closing: str = ""
    group: bool | None = None


OPENING = "An image with "
NOTHING = "An image."


def percentages(digits: int) -> list[str]:
    """Every percentage from 0 to 100 with so many decimals: entry k is k / 10**digits."""
    one = 10**digits
    if not digits:
        return [str(k) for k in range(101)]
    return [f"{k // one}.{k % one:0{digits}d}" for k in range(100 * one + 1)]


def _percentage(objects: Objects, digits: int) -> Column:
    scale = 100 * 10**digits
    return Column(percentages(digits), np.rint(objects.area * scale).astype(np.int64))


def _named(objects: Objects, words: Sequence[Word], form: Callable[[Word, int], str]) -> Column:
    """The distinct (class, count) pairs, each spelled by `form(word, count)`."""
    base = int(objects.count.max(initial=0)) + 1
    key = objects.label.astype(np.int64) * base + objects.count
    # Few classes and counts: a table of all pairs is cheaper than sorting for the distinct ones.
    present = np.bincount(key, minlength=1) > 0
    pairs = np.flatnonzero(present)
    strings = [form(words[pair // base], int(pair % base)) for pair in pairs]
    return Column(strings, (np.cumsum(present) - 1)[key])


def _classes(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    return [_named(objects, words, lambda w, n: w.name if n == 1 else w.plural)]


def _counts(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    return [_named(objects, words, lambda w, n: f"{n} {w.name if n == 1 else w.plural}")]


def _occupancy(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    def who(w: Word, n: int) -> str:
        return f"{w.name} occupy{w.verb_s} " if n == 1 else f"{n} {w.plural} occupy "

    def head(w: Word, n: int) -> str:
        return who(w, n).replace("occupys", "occupies")

    return [
        _named(objects, words, head),
        _percentage(objects, digits),
        Column(["% of the image"]),
    ]


classes = Wording(1, _classes)
counts = Wording(1, _counts, group=True)
occupancy = Wording(1, _occupancy)
