"""A ray caster for scenes of boxes, ellipsoids and gables: image, segment ids and metric depth.

World: x to the right, y forward, z up, metres, the ground at z = 0.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .textures import textured

BOX, ELLIPSOID, GABLE = "box", "ellipsoid", "gable"
_NEAR = 0.05  # m, nothing is nearer to a camera than this


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
        t, n = _CAST[solid.shape](
            *_local(solid, camera.position, rays[(slice(None), *window)]),
            np.array(solid.half, np.float32)[:, None, None],
        )
        closer = t < depth[window]
        depth[window][closer] = t[closer]
        index[window][closer] = i
        normal[(slice(None), *window)][:, closer] = n[:, closer]
    image = _shade(solids, camera, rays, depth, index, normal, outdoors, rng)
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


def _cast_box(origin: np.ndarray, rays: np.ndarray, half: np.ndarray) -> tuple:
    """Depth (h, w), inf where missed, and local normal (3, h, w): the slab method."""
    inverse = 1 / np.where(np.abs(rays) < 1e-9, np.float32(1e-9), rays)
    middle, reach = -origin * inverse, half * np.abs(inverse)
    near = middle - reach
    far = (middle + reach).min(0)
    axis = near.argmax(0)
    t = near.max(0)
    t = np.where((t < far) & (t > _NEAR), t, np.float32(np.inf))
    normal = np.where(axis == np.arange(3)[:, None, None], -np.sign(rays), np.float32(0))
    return t, normal


def _cast_ellipsoid(origin: np.ndarray, rays: np.ndarray, half: np.ndarray) -> tuple:
    """As _cast_box: the unit sphere after scaling by 1 / half."""
    o, d = origin / half, rays / half
    a, b, c = (d * d).sum(0), (o * d).sum(0), (o * o).sum(0) - 1
    root = b * b - a * c
    t = (-b - np.sqrt(np.maximum(root, 0))) / a
    t = np.where((root > 0) & (t > _NEAR), t, np.float32(np.inf))
    normal = (o + np.where(np.isinf(t), np.float32(0), t) * d) / half
    return t, normal / np.maximum(np.sqrt((normal * normal).sum(0)), 1e-9)


def _cast_gable(origin: np.ndarray, rays: np.ndarray, half: np.ndarray) -> tuple:
    """As _cast_box: clipping by the five faces of a triangular prism."""
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
    return np.where((entry < leave) & (entry > _NEAR), entry, np.float32(np.inf)), normal


_CAST = {BOX: _cast_box, ELLIPSOID: _cast_ellipsoid, GABLE: _cast_gable}


def _shade(solids, camera, rays, depth, index, normal, outdoors, rng) -> np.ndarray:
    """uint8 of shape (h, w, 3), RGB: one lamp or sun, contact shadows, haze, grain."""
    import cv2

    hit = index >= 0
    i = index[hit]
    point = rays[:, hit] * depth[hit] + np.array(camera.position, np.float32)[:, None]  # (3, n)
    centre, half, colour, yaw = (
        np.array([getattr(s, name) for s in solids], np.float32).T
        for name in ("centre", "half", "colour", "yaw")
    )
    c, s = np.cos(yaw)[i], np.sin(yaw)[i]
    x, y, z = point - centre[:, i]
    local = np.stack([c * x + s * y, c * y - s * x, z])
    n = normal[:, hit]
    paint = textured([s.texture for s in solids], i, local, half[:, i], n, colour[:, i], depth[hit])
    n = np.stack([c * n[0] - s * n[1], s * n[0] + c * n[1], n[2]])
    light = (
        np.array([-0.35, -0.55, 0.76], np.float32)
        if outdoors
        else np.array([0.30, -0.50, 0.55], np.float32)
    )
    bright = (0.66 if outdoors else 0.70) + 0.40 * np.maximum(light @ n, 0) + 0.06 * n[0]
    bright *= _contact(solids, point, n, reach=0.6 if outdoors else 0.22)
    if not outdoors:
        bright *= 0.72 + 0.28 / (1 + (depth[hit] / 12) ** 2)
    paint = paint * bright
    sky = _sky(rays) if outdoors else np.zeros_like(rays)
    if outdoors:
        haze = 1 - np.exp(-depth[hit] / 260)
        paint = paint * (1 - haze) + haze * np.array([[0.80], [0.86], [0.92]], np.float32)
    canvas = sky
    canvas[:, hit] = paint
    canvas = np.ascontiguousarray(canvas.transpose(1, 2, 0))  # (h, w, 3)
    canvas = _smooth_edges(canvas, index, cv2)
    canvas += rng.standard_normal(index.shape, np.float32)[..., None] * 0.008
    return (np.clip(canvas, 0, 1) * 255 + 0.5).astype(np.uint8)


def _contact(solids, point: np.ndarray, normal: np.ndarray, reach: float) -> np.ndarray:
    """float32 of shape (n,), 0 to 1: darkens the ground around what stands on it."""
    shadow = np.ones(point.shape[1], np.float32)
    ground = np.flatnonzero((normal[2] > 0.9) & (np.abs(point[2]) < 0.12))
    if not len(ground):
        return shadow
    x, y = point[0, ground], point[1, ground]
    dark = np.ones(len(ground), np.float32)
    for solid in solids:
        bottom = solid.centre[2] - solid.half[2]
        if not -0.01 <= bottom < 0.6 or solid.half[2] < 0.05 or max(solid.half[:2]) > 12:
            continue
        c, s = np.cos(solid.yaw), np.sin(solid.yaw)
        dx, dy = x - np.float32(solid.centre[0]), y - np.float32(solid.centre[1])
        outside_x = np.maximum(np.abs(c * dx + s * dy) - solid.half[0], 0)
        outside_y = np.maximum(np.abs(c * dy - s * dx) - solid.half[1], 0)
        depth = 0.42 * np.exp(-bottom / 0.3)
        dark *= 1 - np.float32(depth) * np.exp(-(outside_x + outside_y) / np.float32(reach))
    shadow[ground] = np.maximum(dark, 0.35)
    return shadow


def _sky(rays: np.ndarray) -> np.ndarray:
    """float32 of shape (3, h, w): pale at the horizon, blue above."""
    up = np.clip(rays[2] * 1.6, 0, 1) ** 0.7
    low, high = np.array([0.84, 0.89, 0.94]), np.array([0.42, 0.62, 0.88])
    return (low[:, None, None] * (1 - up) + high[:, None, None] * up).astype(np.float32)


def _smooth_edges(canvas: np.ndarray, index: np.ndarray, cv2) -> np.ndarray:
    """Mixes each pixel at an outline with its neighbours: one ray a pixel leaves stairs."""
    edge = np.zeros(index.shape, bool)
    edge[:, 1:] |= index[:, 1:] != index[:, :-1]
    edge[1:] |= index[1:] != index[:-1]
    soft = cv2.GaussianBlur(canvas, (3, 3), 0.8)
    canvas[edge] = soft[edge]
    return canvas
