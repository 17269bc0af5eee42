"""Puts objects into a scene: keeps them apart, numbers the segments, knows what each one is."""

import tomllib
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...common import class_names
from . import furniture, outdoors
from .sizes import Size, draw_size
from .solids import Solid

# Cloth, lacquer and plaster: muted, so that a scene looks like one.
_COLOURS = (
    (0.62, 0.18, 0.16),
    (0.20, 0.32, 0.52),
    (0.24, 0.42, 0.38),
    (0.74, 0.62, 0.42),
    (0.56, 0.58, 0.60),
    (0.82, 0.80, 0.76),
    (0.27, 0.29, 0.33),
    (0.66, 0.44, 0.28),
    (0.40, 0.48, 0.30),
    (0.50, 0.36, 0.48),
    (0.36, 0.52, 0.66),
    (0.78, 0.50, 0.20),
)
_SHAPES = furniture.SHAPES | outdoors.SHAPES
# COCO has no class of its own for a storage rack.
_CALLED = {"storage rack": "shelf"}


class Category(NamedTuple):
    """A COCO panoptic class: its id, and whether each object of it is a segment of its own."""

    id: int
    thing: bool


@cache
def categories() -> dict[str, Category]:
    """The class of each name; where several share one (wall-brick, wall-other), the last."""
    coco = class_names.table("coco-panoptic")
    return {coco.names[i]: Category(i, i in coco.things) for i in sorted(coco.names)}


@cache
def read_kinds() -> dict[str, dict[str, Any]]:
    """kinds.toml: tables rooms and streets."""
    return tomllib.loads((Path(__file__).parent / "kinds.toml").read_text("utf-8"))


@dataclass
class Builder:
    """A scene under construction.

    clearance : m, the gap that `free` keeps around each footprint.
    solids, names : the scene; names[k] is the class of segment k + 1.
    taken : x1 y1 x2 y2 of each footprint on the ground, m.
    """

    rng: np.random.Generator
    clearance: float = 0.06
    solids: list[Solid] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    taken: list[tuple[float, float, float, float]] = field(default_factory=list)

    def segment(self, name: str) -> int:
        """The id for one more object of this class: a new one for things, the class's for stuff."""
        if name in self.names and not categories()[name].thing:
            return self.names.index(name) + 1
        self.names.append(name)
        return len(self.names)

    def put(self, name: str, size: Size, x: float, y: float, z: float = 0, yaw: float = 0) -> None:
        """Adds one object at x, y, z, m, turned by yaw, rad, in a colour of its own."""
        segment = self.segment(_CALLED.get(name, name))
        colour = _COLOURS[self.rng.integers(len(_COLOURS))]
        shade = float(self.rng.uniform(0.75, 1.15))
        colour = (colour[0] * shade, colour[1] * shade, colour[2] * shade)
        c, s = float(np.cos(yaw)), float(np.sin(yaw))
        for part in _SHAPES[name](size, colour):
            px, py, pz = part.centre
            centre = (x + c * px - s * py, y + s * px + c * py, z + pz)
            self.solids.append(part._replace(centre=centre, yaw=yaw, segment=segment))

    def free(self, x: float, y: float, w: float, d: float) -> bool:
        """Whether a footprint of w by d, m, around x, y meets none that was taken."""
        gap = self.clearance
        x1, y1, x2, y2 = x - w / 2 - gap, y - d / 2 - gap, x + w / 2 + gap, y + d / 2 + gap
        return all(x2 <= a or c <= x1 or y2 <= b or e <= y1 for a, b, c, e in self.taken)

    def take(self, x: float, y: float, w: float, d: float) -> None:
        self.taken.append((x - w / 2, y - d / 2, x + w / 2, y + d / 2))

    def stand(
        self,
        name: str,
        x: float,
        y: float,
        yaw: float = 0.0,
        size: tuple[float, float, float] | None = None,
        turn: bool = False,
    ) -> bool:
        """Puts an object on the ground at x, y if its place is free, and takes the place.

        turn : the footprint lies across (yaw is a quarter turn). Tells whether it was put.
        """
        size = size or draw_size(name, self.rng)
        w, d = (size[1], size[0]) if turn else size[:2]
        if not self.free(x, y, w, d):
            return False
        self.take(x, y, w, d)
        self.put(name, size, x, y, 0.0, yaw)
        return True
