"""Wordings: how each style says what an image shows.

A style is a `Wording`, an entry of registry.STYLES. Its version is stored with the texts and goes
up with any change of wording, so that texts of two versions are never taken for the same.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import pyarrow as pa

from ..common.errors import UsageError
from .assemble import Column
from .objects import Objects
from .words import Word, number_word

NOTHING = "An image."


@dataclass(frozen=True)
class Wording:
    """One style.

    version : of the wording.
    example : a short text in this style, shown by `rsa-data list styles`.
    phrase : (objects, the words of their labels, digits of a percentage) -> the columns whose
        strings side by side are an object's phrase. Columns meet at spaces and signs only, so
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


def _percentage(objects: Objects, digits: int) -> Column:
    return Column(percentages(digits), np.rint(objects.area * (100 * 10**digits)).astype(np.int64))


def _named(objects: Objects, words: Sequence[Word], form: Callable[[Word, int], str]) -> Column:
    """The distinct (class, count) pairs, each spelled by `form(word, count)`."""
    base = int(objects.count.max(initial=0)) + 1
    key = objects.label.astype(np.int64) * base + objects.count
    # Few classes and counts: a table of all pairs is cheaper than sorting for the distinct ones.
    present = np.bincount(key) > 0
    pairs = np.flatnonzero(present).tolist()
    strings = tuple(form(words[pair // base], pair % base) for pair in pairs)
    return Column(strings, (np.cumsum(present) - 1)[key])


def _several(word: Word, count: int) -> str:
    return word.name if count == 1 else f"{count} {word.plural}"


def _classes(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    return [_named(objects, words, lambda w, n: w.name if n == 1 else w.plural)]


def _counts(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    return [_named(objects, words, lambda w, n: f"{n} {w.name if n == 1 else w.plural}")]


def _occupancy(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    def head(w: Word, n: int) -> str:
        return _several(w, n) + (" occupy " if n > 1 or w.is_plural else " occupies ")

    return [
        _named(objects, words, head),
        _percentage(objects, digits),
        Column(("% of the image",)),
    ]


@cache
def _rounded(digits: int) -> tuple[str, ...]:
    # str(round(100 * share, 2)) of the released code: 30.1, not 30.10.
    scale = 10**digits
    return tuple(str(k / scale) if digits else str(k) for k in range(100 * scale + 1))


def _occupied(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    codes = _percentage(objects, digits).codes
    return [
        _named(objects, words, lambda w, n: f"{w.name} occupied "),
        Column(_rounded(digits), codes),
        Column(("% of image",)),
    ]


def _release(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    def form(w: Word, n: int) -> str:
        return w.article + w.name if n == 1 else f"{number_word(n)} {w.plural}"

    return [_named(objects, words, form)]


def _centers(objects: Objects, style: str) -> np.ndarray:
    if objects.center is None:
        raise UsageError(
            f"style {style!r} tells where things are, but these segments have no centers (an "
            "import of classes and shares has none). Use the style occupancy, or segments of a "
            "model or of masks: --segments NAME"
        )
    return objects.center


def _located(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    # The pixel that the center lies in.
    x, y = np.floor(_centers(objects, "located")).astype(np.int64).T
    pixels = tuple(map(str, range(int(max(x.max(initial=0), y.max(initial=0))) + 1)))
    return [
        _named(objects, words, lambda w, n: f"{w.article}{w.name} located at ("),
        Column(pixels, x),
        Column((",",)),
        Column(pixels, y),
        Column((") occupying ",)),
        _percentage(objects, digits),
        Column(("% of the image",)),
    ]


_CELLS = tuple(
    "top left,top,top right,left,center,right,bottom left,bottom,bottom right".split(",")  # noqa: SIM905
)


def _grid(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    center = _centers(objects, "grid")
    if objects.size is None:
        raise UsageError(
            "style 'grid' tells in which third of an image things are, but neither these segments "
            "nor the samples have sizes. Use the style occupancy"
        )
    third = np.clip(np.floor(3 * center / objects.size[objects.image]), 0, 2).astype(np.int64)
    return [
        _named(objects, words, lambda w, n: f"{w.article}{w.name} located in the "),
        Column(_CELLS, 3 * third[:, 1] + third[:, 0]),
        Column((" occupying ",)),
        _percentage(objects, digits),
        Column(("% of the image",)),
    ]


def _camera(samples: pa.Table) -> list[str]:
    rows = samples.select(["sample_id", "fx", "fy", "cx", "cy"]).to_pylist()
    for row in rows:
        if None in row.values():
            raise UsageError(
                f"style 'intrinsics' tells of the camera, but {row['sample_id']} has no focal "
                "lengths and principal point in samples. Use the style occupancy, or a dataset "
                "with intrinsics"
            )
    return [
        "An image taken with focal lengths {fx:.0f} and {fy:.0f} pixels and principal point "
        "({cx:.0f},{cy:.0f}), with ".format(**row)
        for row in rows
    ]


classes = Wording(1, "An image with bed, wall, chair, chair", _classes)
counts = Wording(1, "An image with 1 bed, 1 wall, 2 chairs", _counts, group=True)
occupancy = Wording(
    1, "An image with bed occupies 13.42% of the image, wall occupies ...", _occupancy
)
occupied = Wording(
    1,
    "An image with bed occupied 13.42% of image. As the released code wrote it",
    _occupied,
    closing=".",
    group=False,
)
located = Wording(
    1,
    "An image with a bed located at (124,256) occupying 13.42% of the image, ...",
    _located,
    group=False,
)
grid = Wording(
    1,
    "An image with a bed located in the bottom left occupying 13.42% of the image, ...",
    _grid,
    group=False,
)
intrinsics = Wording(
    1,
    "An image taken with focal lengths 519 and 519 pixels and principal point (326,254), with "
    "bed occupies 13.42% of the image, ...",
    _occupancy,
    opening=_camera,
)
release = Wording(
    1,
    "An image with a bed, a wall, and two chairs. As the release's structured texts",
    _release,
    last=", and ",
    closing=".",
    group=True,
)
