"""A ray caster for scenes of boxes, ellipsoids and gables: image, segment ids and metric depth."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .shading import shade
from .solids import BOX, ELLIPSOID, GABLE, Camera, Solid

_NEAR = 0.05  # m, nothing is nearer to a camera than this


class View(NamedTuple):
    """What a camera sees.

    image : uint8 of shape (h, w, 3), RGB.
    segments : int32 of shape (h, w), Solid.segment of the nearest solid, 0 for none (sky).
    depth : float32 of shape (h, w), m along the optical axis, inf for none.
    """

    image: np.ndarray
    segments: np.ndarray
    depth: np.ndarray


def render(
    solids: list[Solid], camera: Camera, *, outdoors: bool, rng: np.random.Generator
) -> View:
    """Casts one ray a pixel. `rng` draws the grain of the image, nothing else."""
    h, w = camera.height, camera.width
    right, down, forward = camera.axes()
    u = (np.arange(w, dtype=np.float32) + 0.5 - w / 2) / np.float32(camera.focal)
    v = (np.arange(h, dtype=np.float32) + 0.5 - h / 2) / np.float32(camera.focal)
    # One unit along the optical axis, so that the ray's parameter is the depth.  (3, h, w)
    rays = (
        forward[:, None, None] + right[:, None, None] * u + down[:, None, None] * v[:, None]
    ).astype(np.float32)
    depth = np.full((h, w), np.inf, np.float32)
    index = np.full((h, w), -1, np.int32)
    normal = np.zeros((3, h, w), np.float32)
    for i, (solid, window) in enumerate(zip(solids, _windows(solids, camera), strict=True)):
        if window is None:
            continue
        t, normals = _CAST[solid.shape](
            *_local(solid, camera.position, rays[(slice(None), *window)]),
            np.array(solid.half, np.float32)[:, None, None],
        )
        closer = t < depth[window]
        if not closer.any():
            continue
        np.copyto(depth[window], t, where=closer)
        np.copyto(index[window], i, where=closer)
        normal[(slice(None), *window)][:, closer] = normals(closer)
    image = shade(solids, camera, rays, depth, index, normal, outdoors, rng)
    ids = np.array([s.segment for s in solids] + [0], np.int32)[index]
    return View(image, ids, depth)


def _windows(solids: list[Solid], camera: Camera) -> list[tuple[slice, slice] | None]:
    """Rows and columns that can show each solid, None for those out of sight."""
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
    return [
        (slice(int(t), int(b)), slice(int(le), int(r))) if ok else None
        for t, b, le, r, ok in zip(top, bottom, left, right, seen, strict=True)
    ]


def _local(
    solid: Solid, position: tuple[float, float, float], rays: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Origin (3, 1, 1) and rays (3, h, w) in the solid's own frame, float32."""
    origin = np.subtract(position, solid.centre)
    if solid.yaw == 0:
        return origin.astype(np.float32)[:, None, None], rays
    c, s = np.float32(np.cos(solid.yaw)), np.float32(np.sin(solid.yaw))
    turned = np.stack([c * rays[0] + s * rays[1], c * rays[1] - s * rays[0], rays[2]])
    x, y, z = origin
    local = np.array([c * x + s * y, c * y - s * x, z], np.float32)
    return local[:, None, None], turned


Hit = tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]
"""Depth (h, w), inf where missed; pixels, bool (h, w) with n set -> their local normal (3, n)."""


def _cast_box(origin: np.ndarray, rays: np.ndarray, half: np.ndarray) -> Hit:
    """The slab method."""
    inverse = 1 / np.where(np.abs(rays) < 1e-9, np.float32(1e-9), rays)
    middle, reach = -origin * inverse, half * np.abs(inverse)
    near = middle - reach
    far = (middle + reach).min(0)
    t = near.max(0)
    t = np.where((t < far) & (t > _NEAR), t, np.float32(np.inf))

    def normals(pixels: np.ndarray) -> np.ndarray:
        axis = near[:, pixels].argmax(0)
        facing = -np.sign(rays[:, pixels])
        return np.where(axis == np.arange(3)[:, None], facing, np.float32(0))

    return t, normals


def _cast_ellipsoid(origin: np.ndarray, rays: np.ndarray, half: np.ndarray) -> Hit:
    """The unit sphere after scaling by 1 / half."""
    o, d = origin / half, rays / half
    a, b, c = (d * d).sum(0), (o * d).sum(0), (o * o).sum(0) - 1
    root = b * b - a * c
    t = (-b - np.sqrt(np.maximum(root, 0))) / a
    t = np.where((root > 0) & (t > _NEAR), t, np.float32(np.inf))

    def normals(pixels: np.ndarray) -> np.ndarray:
        normal = (o[..., 0] + t[pixels] * d[:, pixels]) / half[..., 0]
        return np.asarray(normal / np.maximum(np.sqrt((normal * normal).sum(0)), 1e-9))

    return t, normals


def _cast_gable(origin: np.ndarray, rays: np.ndarray, half: np.ndarray) -> Hit:
    """Clipping by the five faces of a triangular prism."""
    hx, hy, hz = half[:, 0, 0]
    length = np.hypot(2 * hz, hy)
    slope = (0, 2 * hz / length, hy / length)
    faces = [((1, 0, 0), hx), ((-1, 0, 0), hx), ((0, 0, -1), hz)]
    faces += [((0, side * slope[1], slope[2]), hz * slope[2]) for side in (-1, 1)]
    entry = np.full(rays.shape[1:], -np.inf, np.float32)
    leave = np.full(rays.shape[1:], np.inf, np.float32)
    normal = np.zeros_like(rays)
    for face, distance in faces:
        n = np.array(face, np.float32)[:, None, None]
        speed = (n * rays).sum(0)
        speed = np.where(np.abs(speed) < 1e-9, np.float32(1e-9), speed)
        t = (np.float32(distance) - (n * origin).sum(0)) / speed
        later = (speed < 0) & (t > entry)
        entry = np.where(later, t, entry)
        normal = np.where(later, n, normal)
        leave = np.where(speed > 0, np.minimum(leave, t), leave)
    t = np.where((entry < leave) & (entry > _NEAR), entry, np.float32(np.inf))
    return t, lambda pixels: normal[:, pixels]


_CAST = {BOX: _cast_box, ELLIPSOID: _cast_ellipsoid, GABLE: _cast_gable}
