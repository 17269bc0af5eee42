"""Blocks and colours that the shapes of objects are put together from.

Shapes are built around their own origin, on the floor in the middle of the footprint, x to the
right, y to the back (the front looks to -y), z up. `Solid.segment` is filled in by the scene.
"""

from collections.abc import Callable

from .sizes import Size
from .solids import BOX, Solid

Colour = tuple[float, float, float]
Shape = Callable[[Size, Colour], list[Solid]]

DARK, WHITE, WOOD = (0.16, 0.17, 0.19), (0.93, 0.93, 0.92), (0.58, 0.41, 0.26)
STEEL, LEAF, SKIN = (0.68, 0.70, 0.72), (0.25, 0.45, 0.20), (0.80, 0.61, 0.48)


def block(
    x: float, y: float, z: float, w: float, d: float, h: float, colour: Colour,
    texture: str = "", shape: str = BOX,
) -> Solid:  # fmt: skip
    """A solid of size w, d, h, m, whose footprint is centred at x, y and whose bottom is at z."""
    return Solid(shape, (x, y, z + h / 2), (w / 2, d / 2, h / 2), 0.0, colour, texture, 0)


def legs(w: float, d: float, h: float, colour: Colour, thick: float = 0.05) -> list[Solid]:
    """Four legs below the corners of a top of w by d, m, each `thick` wide and h high."""
    x, y = w / 2 - thick / 2, d / 2 - thick / 2
    return [block(i, j, 0, thick, thick, h, colour) for i in (-x, x) for j in (-y, y)]


def plain(
    colour: Colour, texture: str = "", shape: str = BOX
) -> Callable[[Size, Colour], list[Solid]]:
    """A maker of one solid of a fixed colour, of the size it is given."""
    return lambda size, _: [block(0, 0, 0, *size, colour, texture, shape)]


def tinted(texture: str = "", shape: str = BOX) -> Callable[[Size, Colour], list[Solid]]:
    """A maker of one solid of the size and the colour it is given."""
    return lambda size, colour: [block(0, 0, 0, *size, colour, texture, shape)]


def paler(colour: Colour, least: float, share: float) -> Colour:
    """A colour of plaster: `share` of `colour` on top of a grey of `least`."""
    r, g, b = colour
    return least + share * r, least + share * g, least + share * b
