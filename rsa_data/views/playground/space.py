"""The 3-D view: the points are sent once a picture; scale and shift alone move them afterwards."""

import json
from typing import Any

import numpy as np
from nicegui import ui

from . import desk
from .panels import TALL, empty
from .rays import Rays, rays

# Keeps what the points were made of, y in the place of z, and moves each to its depth.
_MOVE = """
(async () => {
  const space = getElement(%(scene)d);
  let found;
  for (let k = 0; k < 500 && !(found = space.objects.get(%(points)s))?.mesh; k++)
    await new Promise(done => setTimeout(done, 20));
  if (!found?.mesh) return;
  const place = found.mesh.geometry.getAttribute("position");
  found.rays ??= place.array.slice();
  const rays = found.rays, to = place.array;
  for (let k = 0; k < to.length; k += 3) {
    const inverse = %(scale)g * rays[k + 2] + %(shift)g;
    const z = inverse > 0 ? 1 / inverse : 0;
    to[k] = rays[k] * z; to[k + 1] = rays[k + 1] * z;
    // A point without depth stands far behind the eye, where nobody sees it.
    to[k + 2] = z > 0 ? -z : 1e6;
  }
  place.needsUpdate = true;
  found.mesh.frustumCulled = false;
  found.mesh.material.size = %(size)g;
  found.mesh.visible = true;
  document.body.dataset.space = %(told)s;
})()
"""
# The camera is placed again where the median depth has changed by more than this factor.
_MOVED = 3.0
# Vertical field of view of the 3-D view, degrees, and its width over its height at least.
_FOV, _ASPECT = 50, 1.1
_TALL = float(np.tan(np.deg2rad(_FOV / 2)))
# Points as wide as this times their spacing cover the surface; three.js sizes them for 90 degrees.
_COVER = 1.6
# Where it looks from: a little to the right of the photo's camera, and above it.
_FROM = np.array([0.12, 0.2, 1.05]) / np.linalg.norm([0.12, 0.2, 1.05])


class Space:
    """The panel with the points and a cube of 1 m beside them."""

    def __init__(self) -> None:
        with ui.element("div").classes("w-full").style(f"height:{TALL}px") as place:
            self.scene = ui.scene(
                width=400, height=TALL, grid=False, background_color="#e8e8ec",
                camera=ui.scene.perspective_camera(fov=_FOV),
            )  # fmt: skip
            self.scene.classes("w-full")
        self.empty = empty("Appears with the depth.", place).classes("text-black")
        self.points: Any = None
        self.of: Any = None
        self.rays: Rays | None = None
        self.cube: list[Any] = []
        self.seen_at = 0.0
        self.shown = np.zeros((0, 3))

    def clear(self) -> None:
        """Takes the points away."""
        for found in (self.points, *self.cube):
            if found is not None:
                found.delete()
        self.points, self.of, self.rays, self.cube, self.seen_at = None, None, None, [], 0.0
        self.shown = np.zeros((0, 3))
        self.empty.set_text("Appears with the depth.")

    def show(self, picture: desk.Picture, scale: float, shift: float) -> None:
        """Shows the points of a picture at a scale and shift."""
        if self.of is not picture:
            self.clear()
            self.of, self.rays = picture, rays(picture)
            rows = np.stack([self.rays.right, self.rays.up, self.rays.y], 1).round(5)
            with self.scene:
                self.points = self.scene.point_cloud(
                    rows.tolist(), self.rays.colours.round(2).tolist(), 0.01
                ).visible(False)
        assert self.rays is not None
        points = self.rays.points(scale, shift)
        points = points[np.isfinite(points).all(1)]
        if not len(points):
            return
        middle = -float(np.median(points[:, 2]))
        ui.run_javascript(
            _MOVE
            % {
                "scene": self.scene.id,
                "points": json.dumps(self.points.id),
                "scale": scale,
                "shift": shift,
                "size": _COVER * self.rays.spacing * max(middle, 0.01) / _TALL,
                "told": json.dumps(f"{scale:.6g} {shift:.6g}"),
            }
        )
        self.empty.set_text("")
        self.shown = points
        if not self.seen_at / _MOVED < middle < self.seen_at * _MOVED:
            self.look()

    def look(self) -> None:
        """Places the camera so that the points fill the view, and the cube on the ground."""
        points = self.shown
        if not len(points):
            return
        middle = self.seen_at = -float(np.median(points[:, 2]))
        for found in self.cube:
            found.delete()
        near = points[points[:, 2] > -1.5 * middle]
        ground = float(np.quantile(near[:, 1], 0.05))
        left = float(np.quantile(near[:, 0], 0.1))
        with self.scene:
            cube = self.scene.box(1, 1, 1, wireframe=True).material("#c2410c")
            cube.move(left, ground + 0.5, -middle)
            told = self.scene.text("1 m", "color:#c2410c;font-weight:bold").move(
                left, ground + 1.1, -middle
            )
        self.cube = [cube, told]
        x, y, z = eye(points)
        to_x, to_y, to_z = _center(points)
        self.scene.move_camera(
            x, y, z,
            look_at_x=to_x, look_at_y=to_y, look_at_z=to_z, up_x=0, up_y=1, up_z=0, duration=0,
        )  # fmt: skip


def _center(points: np.ndarray) -> tuple[float, float, float]:
    """The middle of the points, without the farthest of them."""
    low, high = np.percentile(points, [5, 95], axis=0)
    x, y, z = (low + high) / 2
    return float(x), float(y), float(z)


def eye(points: np.ndarray) -> tuple[float, float, float]:
    """Where the camera stands so that all but few points (n, 3) are in its view."""
    right = np.cross([0.0, 1.0, 0.0], _FROM)
    right /= np.linalg.norm(right)
    towards = points - _center(points)
    up = np.cross(_FROM, right)
    # A point is in view where its offset is at most tan times its distance along the view.
    needed = (
        np.maximum(np.abs(towards @ right) / (_TALL * _ASPECT), np.abs(towards @ up) / _TALL)
        + towards @ _FROM
    )  # (n,)
    x, y, z = np.array(_center(points)) + float(np.percentile(needed, 99)) * _FROM
    return float(x), float(y), float(z)
