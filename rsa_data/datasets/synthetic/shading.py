"""Light on a rendered scene: enough that a person recognises the place."""

import numpy as np

from .solids import Camera, Solid
from .textures import textured


def shade(
    solids: list[Solid],
    camera: Camera,
    rays: np.ndarray,
    depth: np.ndarray,
    index: np.ndarray,
    normal: np.ndarray,
    outdoors: bool,
    rng: np.random.Generator,
) -> np.ndarray:
    """uint8 of shape (h, w, 3), RGB: one lamp or sun, contact shadows, haze, grain.

    rays : float32 (3, h, w), of length 1 along the optical axis. depth : float32 (h, w), m, inf
    for the sky. index : int (h, w), the solid that is seen, -1 for the sky. normal : float32
    (3, h, w), in the solid's own frame.
    """
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
    canvas = _smooth_edges(canvas, index)
    canvas += rng.standard_normal(index.shape, np.float32)[..., None] * 0.008
    return np.asarray(np.clip(canvas, 0, 1) * 255 + 0.5).astype(np.uint8)


def _contact(
    solids: list[Solid], point: np.ndarray, normal: np.ndarray, reach: float
) -> np.ndarray:
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
        far = np.float32(np.hypot(*solid.half[:2]) + 5 * reach)
        near = np.flatnonzero((np.abs(dx) < far) & (np.abs(dy) < far))
        dx, dy = dx[near], dy[near]
        outside_x = np.maximum(np.abs(c * dx + s * dy) - solid.half[0], 0)
        outside_y = np.maximum(np.abs(c * dy - s * dx) - solid.half[1], 0)
        depth = 0.42 * np.exp(-bottom / 0.3)
        dark[near] *= 1 - np.float32(depth) * np.exp(-(outside_x + outside_y) / np.float32(reach))
    shadow[ground] = np.maximum(dark, 0.35)
    return shadow


def _sky(rays: np.ndarray) -> np.ndarray:
    """float32 of shape (3, h, w): pale at the horizon, blue above."""
    up = np.clip(rays[2] * 1.6, 0, 1) ** 0.7
    low, high = np.array([0.84, 0.89, 0.94]), np.array([0.42, 0.62, 0.88])
    return np.asarray(low[:, None, None] * (1 - up) + high[:, None, None] * up, np.float32)


def _smooth_edges(canvas: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Mixes each pixel at an outline with its neighbours: one ray a pixel leaves stairs."""
    import cv2

    edge = np.zeros(index.shape, bool)
    edge[:, 1:] |= index[:, 1:] != index[:, :-1]
    edge[1:] |= index[1:] != index[:-1]
    soft = cv2.GaussianBlur(canvas, (3, 3), 0.8)
    canvas[edge] = soft[edge]
    return canvas
