"""Where rays enter boxes, ellipsoids and gables, and which way the surface faces there.

Vectors are three arrays, x, y and z, float32, in a body's own frame. Everything is elementwise: one
body and many rays, or a body of its own for each ray, give the same floats.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from .solids import BOX, ELLIPSOID, GABLE, Solid

Vector = tuple[np.ndarray, np.ndarray, np.ndarray]


class Rays(NamedTuple):
    """Directions of rays, and 1 over them: all that boxes need, and dividing is slow."""

    along: Vector
    inverse: Vector

    @classmethod
    def of(cls, along: Vector) -> "Rays":
        """Rays in these directions."""
        return cls(along, _each(_inverse, along))

    def part(self, rows: slice, columns: slice) -> "Rays":
        """A window of rays whose x and y are of shape (h, w) and whose z is of shape (h, 1)."""
        along, inverse = ((x[rows, columns], y[rows, columns], z[rows]) for x, y, z in self)
        return Rays(along, inverse)


class Bodies(NamedTuple):
    """Numbers of n solids that casting needs, float32 of shape (3, n) or (n,).

    origin : the camera in each solid's own frame, m. half : m. cos, sin : of the yaw.
    """

    origin: np.ndarray
    half: np.ndarray
    cos: np.ndarray
    sin: np.ndarray

    def place(self, i: int | np.ndarray) -> tuple[Vector, Vector]:
        """Origin and half of one solid, or of one for each ray."""
        return at(self.origin, i), at(self.half, i)

    def turn(self, i: int | np.ndarray, rays: Vector) -> Vector:
        """Rays of the world in the frame of one solid, or each in that of its own."""
        x, y, z = rays
        return (*turned(self.cos[i], self.sin[i], x, y), z)


def bodies(solids: list[Solid], position: tuple[float, float, float]) -> Bodies:
    """The table of solids as seen from a position in the world, m."""
    cos = np.array([np.cos(s.yaw) for s in solids], np.float32)
    sin = np.array([np.sin(s.yaw) for s in solids], np.float32)
    x, y, z = np.subtract(position, [s.centre for s in solids]).T
    origin = np.array([*turned(cos, sin, x, y), z], np.float32)
    half = np.ascontiguousarray(np.array([s.half for s in solids], np.float32).T)
    return Bodies(origin, half, cos, sin)


def turned(
    cos: np.ndarray, sin: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """x and y of the world along the axes of what is turned by an angle."""
    return cos * x + sin * y, cos * y - sin * x


def at(vectors: Iterable[np.ndarray], i: int | np.ndarray | slice) -> Vector:
    """Some of many vectors, x, y and z of each in an array."""
    x, y, z = (axis[i] for axis in vectors)
    return x, y, z


def picked(mask: np.ndarray) -> np.ndarray | slice:
    """Index of what is set in a mask of shape (n,); a slice, which copies nothing, if all is."""
    return slice(None) if mask.all() else np.flatnonzero(mask)


def enter(shape: str, origin: Vector, rays: Rays, half: Vector) -> tuple[np.ndarray, np.ndarray]:
    """Depth of the way in and of the way out; the way out is not beyond it where a ray misses."""
    return _ENTER[shape](origin, rays, half)


def normals(shape: str, origin: Vector, along: Vector, half: Vector, depth: np.ndarray) -> Vector:
    """Unit vectors out of the surface, where rays enter at this depth, which `enter` gave."""
    return _NORMALS[shape](origin, along, half, depth)


def _each(f: Callable[..., np.ndarray], *vectors: Iterable[np.ndarray]) -> Vector:
    x, y, z = map(f, *vectors)
    return x, y, z


def _dot(a: Vector, b: Vector) -> np.ndarray:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _inverse(ray: np.ndarray) -> np.ndarray:
    return np.asarray(1 / np.where(np.abs(ray) < 1e-9, np.float32(1e-9), ray))


def _slab(origin: np.ndarray, inverse: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, ...]:
    middle, reach = -origin * inverse, np.abs(inverse)
    reach *= half
    near = middle - reach
    middle += reach
    return near, middle


def _enter_box(origin: Vector, rays: Rays, half: Vector) -> tuple[np.ndarray, np.ndarray]:
    """The slab method."""
    x, y, z = map(_slab, origin, rays.inverse, half)
    near, far = np.maximum(x[0], y[0]), np.minimum(x[1], y[1])
    return np.maximum(near, z[0], out=near), np.minimum(far, z[1], out=far)


def _box_normals(origin: Vector, along: Vector, half: Vector, depth: np.ndarray) -> Vector:
    """Along the axis whose slab the ray entered last: the depth is that slab's to the bit."""
    on_x, on_y = (
        _slab(o, _inverse(ray), h)[0] >= depth
        for o, ray, h in zip(origin[:2], along[:2], half[:2], strict=True)
    )
    on_y &= ~on_x
    chosen = (on_x, on_y, ~(on_x | on_y))
    return _each(lambda on, ray: np.where(on, -np.sign(ray), np.float32(0)), chosen, along)


def _unit_sphere(origin: Vector, along: Vector, half: Vector) -> tuple[Vector, Vector]:
    return _each(np.divide, origin, half), _each(np.divide, along, half)


def _enter_ellipsoid(origin: Vector, rays: Rays, half: Vector) -> tuple[np.ndarray, np.ndarray]:
    """The unit sphere after scaling by 1 / half."""
    o, d = _unit_sphere(origin, rays.along, half)
    a, b, c = _dot(d, d), _dot(o, d), _dot(o, o) - 1
    root = b * b - a * c
    t = (-b - np.sqrt(np.maximum(root, 0))) / a
    return t, np.where(root > 0, np.float32(np.inf), np.float32(-np.inf))


def _ellipsoid_normals(origin: Vector, along: Vector, half: Vector, depth: np.ndarray) -> Vector:
    o, d = _unit_sphere(origin, along, half)
    normal = _each(lambda o, d, h: (o + depth * d) / h, o, d, half)
    length = np.maximum(np.sqrt(_dot(normal, normal)), 1e-9)
    return _each(lambda n: n / length, normal)


def _gable_faces(half: Vector) -> list[tuple[tuple[np.ndarray | float, ...], np.ndarray]]:
    """Normal and distance from the origin of the five faces of a triangular prism."""
    hx, hy, hz = half
    length = np.hypot(2 * hz, hy)
    side, up = 2 * hz / length, hy / length
    ends = [((1.0, 0.0, 0.0), hx), ((-1.0, 0.0, 0.0), hx), ((0.0, 0.0, -1.0), hz)]
    return [*ends, *(((0.0, sign * side, up), hz * up) for sign in (-1, 1))]


def _clip_gable(origin: Vector, along: Vector, half: Vector) -> tuple[np.ndarray, ...]:
    """Depth of the way in and of the way out, and the normal on the way in, (3, ...)."""
    x, y, z = along
    shape = np.broadcast_shapes(x.shape, z.shape)
    entry = np.full(shape, -np.inf, np.float32)
    leave = np.full(shape, np.inf, np.float32)
    normal = np.zeros((3, *shape), np.float32)
    for n, distance in _gable_faces(half):
        speed = n[0] * x + n[1] * y + n[2] * z
        speed = np.where(np.abs(speed) < 1e-9, np.float32(1e-9), speed)
        t = (distance - (n[0] * origin[0] + n[1] * origin[1] + n[2] * origin[2])) / speed
        later = (speed < 0) & (t > entry)
        entry = np.where(later, t, entry)
        for axis, value in zip(normal, n, strict=True):
            np.copyto(axis, value, where=later)
        leave = np.where(speed > 0, np.minimum(leave, t), leave)
    return entry, leave, normal


def _enter_gable(origin: Vector, rays: Rays, half: Vector) -> tuple[np.ndarray, np.ndarray]:
    entry, leave, _ = _clip_gable(origin, rays.along, half)
    return entry, leave


def _gable_normals(origin: Vector, along: Vector, half: Vector, depth: np.ndarray) -> Vector:
    return _each(np.asarray, _clip_gable(origin, along, half)[2])


_ENTER = {BOX: _enter_box, ELLIPSOID: _enter_ellipsoid, GABLE: _enter_gable}
_NORMALS = {BOX: _box_normals, ELLIPSOID: _ellipsoid_normals, GABLE: _gable_normals}
