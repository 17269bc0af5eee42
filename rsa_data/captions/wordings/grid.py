"""The style `grid`: in which ninth of the image each object lies."""

from collections.abc import Sequence

import numpy as np

from ...common.errors import UsageError
from ..assemble import Column
from ..objects import Objects
from ..words import Word
from .wording import Wording, centers, named, percentage

_CELLS = tuple(
    "top left,top,top right,left,center,right,bottom left,bottom,bottom right".split(",")  # noqa: SIM905
)


def _grid(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    center = centers(objects, "grid")
    if objects.size is None:
        raise UsageError(
            "style 'grid' tells in which third of an image things are, but neither these segments "
            "nor the samples have sizes. Use the style occupancy"
        )
    third = np.clip(np.floor(3 * center / objects.size[objects.image]), 0, 2).astype(np.int64)
    return [
        named(objects, words, lambda w, n: f"{w.article}{w.name} located in the "),
        Column(_CELLS, 3 * third[:, 1] + third[:, 0]),
        Column((" occupying ",)),
        percentage(objects, digits),
        Column(("% of the image",)),
    ]


grid = Wording(
    1,
    "An image with a bed located in the bottom left occupying 13.42% of the image, ...",
    _grid,
    group=False,
)
