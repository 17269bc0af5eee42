"""The style `grid`: in which ninth of the image each object lies."""

from collections.abc import Sequence

from ...common.errors import UsageError
from ..assemble import Column
from ..objects import Objects
from ..words import Word
from .wording import Wording, named, percentage

_CELLS = tuple(
    "top left,top,top right,left,center,right,bottom left,bottom,bottom right".split(",")  # noqa: SIM905
)


def _grid(objects: Objects, words: Sequence[Word], digits: int) -> list[Column]:
    if objects.cell is None:
        raise UsageError(
            "style 'grid' tells in which ninth of the image most of an object lies, but these "
            "segments do not say it (an import of classes and shares cannot; segments of an older "
            "version can be made again). Use the style occupancy, or segments of a model or of "
            "masks: --segments NAME"
        )
    return [
        named(objects, words, lambda w, n: f"{w.article}{w.name} located in the "),
        Column(_CELLS, objects.cell),
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
