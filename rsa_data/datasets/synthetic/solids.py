"""What scenes are made of, and what looks at them.

World: x to the right, y forward, z up, metres, the ground at z = 0.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

BOX, ELLIPSOID, GABLE = "box", "ellipsoid", "gable"


class Solid(NamedTuple):
    """A convex body, turned about the vertical axis only.

    shape : BOX, ELLIPSOID, or GABLE (a roof whose ridge runs along local x).
    centre, half : m, world position of the middle and half the extent along the local axes.
    yaw : rad, from world x to local x, anticlockwise seen from above.
    colour : red, green, blue, 0 to 1.
    texture : a name of textures.TEXTURES, or "".
    segment : id of the segment that it belongs to, 1 and up.
    """

    shape: str
    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    yaw: float
    colour: tuple[float, float, float]
    texture: str
    segment: int


@dataclass(frozen=True)
class Camera:
    """A pinhole camera without roll, its principal point in the middle of the image.

    position : m. yaw : rad, anticlockwise from world y. pitch : rad, upwards. focal, width,
    height : px.
    """

    position: tuple[float, float, float]
    yaw: float
    pitch: float
    focal: float
    width: int
    height: int

    def axes(self) -> np.ndarray:
        """float64 of shape (3, 3): right, down and forward as rows, unit vectors of the world."""
        cy, sy, cp, sp = np.cos(self.yaw), np.sin(self.yaw), np.cos(self.pitch), np.sin(self.pitch)
        return np.array([[cy, sy, 0], [-sy * sp, cy * sp, -cp], [-sy * cp, cy * cp, sp]])
