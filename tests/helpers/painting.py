"""A function whose signature and docstring become options of a command."""

from pathlib import Path
from typing import Literal


def paint(
    *,
    colour: Literal["red", "blue"] = "red",
    layers: int = 2,
    share: float | None = None,
    file: Path | None = None,
    dry: bool = False,
):
    """Paints.

    Parameters
    ----------
    colour : what it looks like; more is not said.
    layers : how many times
        it is painted. Twice will do.
    share : of the wall.
    """
    return colour, layers, share, file, dry
