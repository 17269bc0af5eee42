"""A ray caster for scenes of boxes, ellipsoids and gables: which solid each pixel sees, how far."""

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from .shapes import Bodies, Rays, Vector, at, bodies, enter, normals
from .solids import BOX, ELLIPSOID, GABLE, Camera, Solid

_NEAR = 0.05  # m, nothing is nearer to a camera than this


@dataclass(frozen=True, eq=False)
class View:
    """What a camera sees of solids.

    rays : float32 of shape (3, h, w), one a pixel, of length 1 along the optical axis.
    depth : float32 of shape (h, w), m along the optical axis, inf for none.
    index : int32 of shape (h, w), place of the nearest solid in solids, -1 for none (sky).
    """

    solids: list[Solid]
    camera: Camera
    bodies: Bodies
    rays: np.ndarray
    depth: np.ndarray
    index: np.ndarray

    @property
    def segments(self) -> np.ndarray:
        """int32 of shape (h, w), Solid.segment of the nearest solid, 0 for none."""
        ids = np.array([s.segment for s in self.solids] + [0], np.int32)
        return np.asarray(ids[self.index])


def cast(solids: list[Solid], camera: Camera) -> View:
    """Casts one ray a pixel."""
    h, w = camera.height, camera.width
    rays = _rays(camera)
    table = bodies(solids, camera.position)
    depth = np.full((h, w), np.inf, np.float32)
    index = np.full((h, w), -1, np.int32)
    windows = _windows(solids, camera)
    inside = [i for i, (top, bottom, left, right) in enumerate(windows) if top < bottom]
    # The parts of one object are turned alike: their rays are turned once.
    for _, group in groupby(inside, key=lambda i: solids[i].yaw):
        run = list(group)
        tops, bottoms, lefts, rights = zip(*(windows[i] for i in run), strict=True)
        y0, x0 = min(tops), min(lefts)
        x, y, z = rays[:, y0 : max(bottoms), x0 : max(rights)]
        # A camera does not roll: z is the same along a row.
        turned = Rays.of(table.turn(run[0], (x, y, z[:, :1])))
        for i in run:
            top, bottom, left, right = windows[i]
            window = slice(top, bottom), slice(left, right)
            part = turned.part(slice(top - y0, bottom - y0), slice(left - x0, right - x0))
            origin, half = table.place(i)
            t, out = enter(solids[i].shape, origin, part, half)
            closer = t < np.minimum(out, depth[window], out=out)
            closer &= t > _NEAR
            np.copyto(depth[window], t, where=closer)
            np.copyto(index[window], i, where=closer)
    return View(solids, camera, table, rays, depth, index)


def facing(view: View, i: np.ndarray, rays: Vector, depth: np.ndarray) -> Vector:
    """Unit normals, each in the frame of the solid that it belongs to.

    i : int of shape (n,), the solid that each of n rays ends on, at this depth, m.
    """
    origin, half = view.bodies.place(i)
    along = view.bodies.turn(i, rays)
    # Taken for boxes first, as most are: picking those out would take longer.
    normal = normals(BOX, origin, along, half, depth)
    for shape in (ELLIPSOID, GABLE):
        here = np.flatnonzero(np.array([s.shape == shape for s in view.solids])[i])
        if here.size:
            o, a, h = at(origin, here), at(along, here), at(half, here)
            found = normals(shape, o, a, h, depth[here])
            for axis, values in zip(normal, found, strict=True):
                axis[here] = values
    return normal


def _rays(camera: Camera) -> np.ndarray:
    """float32 of shape (3, h, w): one unit along the optical axis, so depth is how far to go."""
    h, w = camera.height, camera.width
    right, down, forward = camera.axes()
    u = (np.arange(w, dtype=np.float32) + 0.5 - w / 2) / np.float32(camera.focal)
    v = (np.arange(h, dtype=np.float32) + 0.5 - h / 2) / np.float32(camera.focal)
    rays = forward[:, None, None] + right[:, None, None] * u + down[:, None, None] * v[:, None]
    return np.asarray(rays, np.float32)


def _windows(solids: list[Solid], camera: Camera) -> list[list[int]]:
    """Top, bottom, left, right that can show each solid, px; all 0 for those out of sight."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8)
    half, centre = np.array([s.half for s in solids]), np.array([s.centre for s in solids])
    yaw = np.array([s.yaw for s in solids])[:, None]
    x, y, z = (signs * half[:, :, None]).transpose(1, 0, 2)  # (n, 8) each
    c, s = np.cos(yaw), np.sin(yaw)
    corners = np.stack([c * x - s * y, s * x + c * y, z], 1)  # (n, 3, 8)
    corners += (centre - camera.position)[:, :, None]
    x, y, z = (camera.axes() @ corners).transpose(1, 0, 2)  # (n, 8) each
    nearest, farthest = z.min(1), z.max(1)
    z = np.maximum(z, _NEAR)
    columns = np.clip(camera.focal * x / z + camera.width / 2, 0, camera.width)
    rows = np.clip(camera.focal * y / z + camera.height / 2, 0, camera.height)
    # What reaches behind the camera has no outline that could be projected.
    whole = nearest < _NEAR
    left = np.where(whole, 0, np.floor(columns.min(1))).astype(int)
    right = np.where(whole, camera.width, np.ceil(columns.max(1))).astype(int)
    top = np.where(whole, 0, np.floor(rows.min(1))).astype(int)
    bottom = np.where(whole, camera.height, np.ceil(rows.max(1))).astype(int)
    seen = (farthest >= _NEAR) & (left < right) & (top < bottom)
    windows: list[list[int]] = (np.stack([top, bottom, left, right], 1) * seen[:, None]).tolist()
    return windows
