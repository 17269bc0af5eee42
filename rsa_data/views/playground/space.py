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


class Space:
    """The panel with the points and a cube of 1 m beside them."""

    def __init__(self) -> None:
        with ui.element("div").classes("w-full").style(f"height:{TALL}px") as place:
            self.scene = ui.scene(width=400, height=TALL, grid=False, background_color="#e8e8ec")
            self.scene.classes("w-full")
        self.empty = empty("Appears with the depth.", place).classes("text-black")
        self.points: Any = None
        self.of: Any = None
        self.rays: Rays | None = None
        self.cube: list[Any] = []
        self.seen_at = 0.0

    def clear(self) -> None:
        """Takes the points away."""
        for found in (self.points, *self.cube):
            if found is not None:
                found.delete()
        self.points, self.of, self.rays, self.cube, self.seen_at = None, None, None, [], 0.0
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
        far, middle = -float(points[:, 2].min()), -float(np.median(points[:, 2]))
        ui.run_javascript(
            _MOVE
            % {
                "scene": self.scene.id,
                "points": json.dumps(self.points.id),
                "scale": scale,
                "shift": shift,
                "size": max(far, 0.1) / 90,
                "told": json.dumps(f"{scale:.6g} {shift:.6g}"),
            }
        )
        self.empty.set_text("")
        if not self.seen_at / _MOVED < middle < self.seen_at * _MOVED:
            self._look(points, middle)

    def _look(self, points: np.ndarray, middle: float) -> None:
        """Places the camera behind and above the photo's own, and the cube on the ground."""
        self.seen_at = middle
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
        self.scene.move_camera(
            0.12 * middle, 0.2 * middle, 0.05 * middle,
            look_at_x=0, look_at_y=0, look_at_z=-middle, up_x=0, up_y=1, up_z=0, duration=0,
        )  # fmt: skip
