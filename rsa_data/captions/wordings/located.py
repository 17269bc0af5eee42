"""The style `located`: in which pixel of the image each object has its center."""

from collections.abc import Sequence

import numpy as np

from ..assemble import Column
from ..objects import Objects
from ..words import Word
from .wording import Wording, centers, named, percentage


def _located(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    # The pixel that the center lies in.
    x, y = np.floor(centers(objects, "located")).astype(np.int64).T
    pixels = tuple(map(str, range(int(max(x.max(initial=0), y.max(initial=0))) + 1)))
    return [
        named(objects, words, lambda w, n: f"{w.article}{w.name} located at ("),
        Column(pixels, x),
        Column((",",)),
        Column(pixels, y),
        Column((") occupying ",)),
        percentage(objects, digits),
        Column(("% of the image",)),
    ]


located = Wording(
    1,
    "An image with a bed located at (124,256) occupying 13.42% of the image, ...",
    _located,
    group=False,
)
