"""Pixels of a picture as rays, of which a browser makes points for any scale and shift."""

from dataclasses import dataclass

import numpy as np

from ...heads.metric import to_metric
from . import desk

_POINTS = 20_000


@dataclass(frozen=True)
class Rays:
    """Pixels of a picture as a browser turns them into points, for any scale and shift.

    The point of a ray is z * (right, up, -1), z = 1 / (scale * y + shift), m.

    right, up : float32 (n,). y : float32 (n,), relative depth. colours : (n, 3), 0 to 1.
    spacing : between neighbours at 1 m, in m.
    """

    right: np.ndarray
    up: np.ndarray
    y: np.ndarray
    colours: np.ndarray
    spacing: float

    def points(self, scale: float, shift: float) -> np.ndarray:
        """(n, 3), m, y up and z towards the viewer; nan where there is no depth."""
        z = to_metric(self.y, scale, shift)
        z = np.where(np.isfinite(z) & (z > 0), z, np.nan)
        return np.stack([self.right * z, self.up * z, -z], 1)


def rays(picture: desk.Picture) -> Rays:
    """At most 20,000 pixels, evenly, without the farthest 2%: they would make all else small."""
    assert picture.y is not None
    height, width = picture.y.shape
    step = max(1, int(np.ceil(np.sqrt(height * width / _POINTS))))
    v, u = (g.ravel() for g in np.mgrid[0:height:step, 0:width:step])
    y = picture.y[v, u]
    good = np.isfinite(y)
    # Depth falls with y, whatever scale and shift.
    good &= y >= np.quantile(y[good], 0.02) if good.any() else good
    u, v, y = u[good], v[good], y[good]
    fx, fy, cx, cy = picture.view()
    down, across = (np.array(picture.image.shape[:2]) / picture.y.shape).tolist()
    colours = picture.image[(v * down).astype(int), (u * across).astype(int)]
    return Rays((u - cx) / fx, (cy - v) / fy, y, colours / 255, step / fx)
