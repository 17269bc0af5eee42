"""Light on a rendered scene: enough that a person recognises the place."""

import numpy as np

from .render import View, facing
from .shapes import Vector, at, picked, turned
from .solids import Solid
from .textures import textured

_HAZE = np.array([0.80, 0.86, 0.92], np.float32)
_HORIZON, _ZENITH = np.array([0.84, 0.89, 0.94]), np.array([0.42, 0.62, 0.88])


def shade(view: View, outdoors: bool, rng: np.random.Generator) -> np.ndarray:
    """uint8 of shape (h, w, 3), RGB: one lamp or sun, contact shadows, haze, grain.

    `rng` draws the grain, nothing else.
    """
    import cv2

    solids = view.solids
    hit = picked(view.index.ravel() >= 0)
    i = view.index.ravel()[hit].astype(np.intp)
    depth = view.depth.ravel()[hit]
    rays = at(view.rays.reshape(3, -1), hit)
    point = rays[0] * depth, rays[1] * depth, rays[2] * depth
    for axis, start in zip(point, view.camera.position, strict=True):
        axis += np.float32(start)
    centre, half, colour, yaw = (
        np.array([getattr(s, name) for s in solids], np.float32).T
        for name in ("centre", "half", "colour", "yaw")
    )
    c, s = np.cos(yaw)[i], np.sin(yaw)[i]
    x, y, z = (axis - middle[i] for axis, middle in zip(point, centre, strict=True))
    n = facing(view, i, rays, depth)
    pattern = textured([s.texture for s in solids], i, (*turned(c, s, x, y), z), half[2], n, depth)
    n = c * n[0] - s * n[1], s * n[0] + c * n[1], n[2]
    light = (
        np.array([-0.35, -0.55, 0.76], np.float32)
        if outdoors
        else np.array([0.30, -0.50, 0.55], np.float32)
    )
    bright = (0.66 if outdoors else 0.70) + 0.40 * np.maximum(light @ np.stack(n), 0) + 0.06 * n[0]
    bright *= _contact(solids, point, n[2], reach=0.6 if outdoors else 0.22)
    if not outdoors:
        bright *= 0.72 + 0.28 / (1 + (depth / 12) ** 2)
    haze = 1 - np.exp(-depth / 260) if outdoors else None
    canvas = np.zeros((3, *view.index.shape), np.float32)
    for k, plane in enumerate(canvas):
        paint = colour[k][i]
        paint *= pattern
        paint *= bright
        if haze is not None:
            plane[:] = _sky(view.rays[2, :, :1], k)
            paint *= 1 - haze
            paint += haze * _HAZE[k]
        plane.ravel()[hit] = paint
    smooth = _smooth_edges(cv2.merge(list(canvas)), view.index)
    grain = rng.standard_normal(view.index.shape, np.float32) * 0.008
    smooth += cv2.merge([grain] * 3)
    np.clip(smooth, 0, 1, out=smooth)
    smooth *= 255
    smooth += 0.5
    return smooth.astype(np.uint8)


def _contact(solids: list[Solid], point: Vector, up: np.ndarray, reach: float) -> np.ndarray:
    """float32 of shape (n,), 0 to 1: darkens the ground around what stands on it.

    point : m, in the world. up : float32 of shape (n,), z of the normal.
    """
    shadow = np.ones(len(up), np.float32)
    ground = np.flatnonzero((up > 0.9) & (np.abs(point[2]) < 0.12))
    if not len(ground):
        return shadow
    x, y = point[0][ground], point[1][ground]
    dark = np.ones(len(ground), np.float32)
    low_x, high_x, low_y, high_y = x.min(), x.max(), y.min(), y.max()
    for solid in solids:
        bottom = solid.centre[2] - solid.half[2]
        if not -0.01 <= bottom < 0.6 or solid.half[2] < 0.05 or max(solid.half[:2]) > 12:
            continue
        c, s = np.cos(solid.yaw), np.sin(solid.yaw)
        centre_x, centre_y = np.float32(solid.centre[0]), np.float32(solid.centre[1])
        far = np.float32(np.hypot(*solid.half[:2]) + 5 * reach)
        if max(low_x - centre_x, centre_x - high_x, low_y - centre_y, centre_y - high_y) >= far:
            continue
        near = np.flatnonzero(np.abs(x - centre_x) < far)
        near = near[np.abs(y[near] - centre_y) < far]
        dx, dy = np.float64(x[near] - centre_x), np.float64(y[near] - centre_y)
        outside_x = np.maximum(np.abs(c * dx + s * dy) - solid.half[0], 0)
        outside_y = np.maximum(np.abs(c * dy - s * dx) - solid.half[1], 0)
        depth = 0.42 * np.exp(-bottom / 0.3)
        dark[near] *= 1 - np.float32(depth) * np.exp(-(outside_x + outside_y) / np.float32(reach))
    shadow[ground] = np.maximum(dark, 0.35)
    return shadow


def _sky(rise: np.ndarray, channel: int) -> np.ndarray:
    """Pale at the horizon, blue above; rise : float32, z of rays."""
    up = np.clip(rise * 1.6, 0, 1) ** 0.7
    return np.asarray(_HORIZON[channel] * (1 - up) + _ZENITH[channel] * up)


def _smooth_edges(canvas: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Mixes each pixel at an outline with its neighbours: one ray a pixel leaves stairs."""
    import cv2

    edge = np.zeros(index.shape, bool)
    edge[:, 1:] |= index[:, 1:] != index[:, :-1]
    edge[1:] |= index[1:] != index[:-1]
    soft = cv2.GaussianBlur(canvas, (3, 3), 0.8)
    return np.asarray(cv2.copyTo(soft, edge.view(np.uint8), canvas))
