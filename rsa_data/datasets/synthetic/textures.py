"""Patterns on surfaces, so that a rendered scene can be recognised: planks, tiles, facades."""

from collections.abc import Sequence

import numpy as np

from .shapes import Vector, at


def _planks(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    row = np.floor(v / 0.14)
    joint = (np.mod(v, 0.14) < 0.008) | (np.mod(u + row * 0.37, 1.3) < 0.01)
    return np.where(
        joint, 0.72, 0.93 + 0.10 * np.mod(row * 0.618 + np.floor((u + row * 0.37) / 1.3) * 0.38, 1)
    )


def _tiles(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.where((np.mod(u, 0.3) < 0.012) | (np.mod(v, 0.3) < 0.012), 0.80, 1.0)


def _large_tiles(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.asarray(0.92 + 0.08 * np.mod(np.floor(u / 0.9) + np.floor(v / 0.9), 2))


def _bricks(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    row = np.floor(v / 0.12)
    joint = (np.mod(v, 0.12) < 0.018) | (np.mod(u + 0.14 * np.mod(row, 2), 0.28) < 0.018)
    return np.where(joint, 1.18, 0.9 + 0.16 * np.mod(row * 0.618 + np.floor(u / 0.28) * 0.414, 1))


def _siding(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.where(np.mod(v, 0.22) < 0.03, 0.86, 1.0)


def _books(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    row = np.mod(v, 0.36)
    book = 0.55 + 0.6 * np.mod(np.floor(u / 0.05) * 0.618 + np.floor(v / 0.36) * 0.27, 1)
    return np.where(row > 0.29, 0.35, book)


def _leaves(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    waves = np.sin(9 * u + 4 * np.sin(5 * v)) * np.sin(8 * v + 3 * np.sin(7 * u))
    return np.asarray(0.86 + 0.17 * waves)


def _asphalt(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    waves = np.sin(3.1 * u + np.sin(1.7 * v)) * np.sin(2.3 * v + np.sin(2.9 * u))
    return np.asarray(0.97 + 0.05 * waves)


def _stripes(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.asarray(0.88 + 0.12 * np.mod(np.floor(u / 0.12), 2))


def _facade(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Windows of about 1.3 m by 1.5 m, 2.6 m apart, a storey every 3 m."""
    across, up = np.abs(np.mod(u, 2.6) - 1.3), np.abs(np.mod(v, 3.0) - 1.75)
    pane = (across < 0.62) & (up < 0.75)
    frame = (across < 0.72) & (up < 0.85)
    lit = 0.40 + 0.16 * np.mod(np.floor(u / 2.6) * 0.618 + np.floor(v / 3.0) * 0.414, 1)
    return np.where(pane, lit, np.where(frame, 1.15, 1.0))


def _house_front(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """As _facade with wider gaps; v counts from the ground."""
    across, up = np.abs(np.mod(u, 3.2) - 1.6), np.abs(np.mod(v, 2.9) - 1.6)
    pane = (across < 0.6) & (up < 0.6)
    frame = (across < 0.72) & (up < 0.72)
    bar = across < 0.05
    return np.where(pane & ~bar, 0.42, np.where(frame, 1.2, 1.0))


def _panes(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.where((np.abs(u) < 0.03) | (np.mod(v, 0.7) < 0.03), 0.72, 1.0 + 0.06 * v)


TEXTURES = {
    "planks": _planks,
    "tiles": _tiles,
    "large tiles": _large_tiles,
    "bricks": _bricks,
    "siding": _siding,
    "books": _books,
    "leaves": _leaves,
    "asphalt": _asphalt,
    "stripes": _stripes,
    "facade": _facade,
    "house front": _house_front,
    "panes": _panes,
}

_NAMES = list(TEXTURES)
_NUMBERS = {name: number for number, name in enumerate(_NAMES)}
_FINE = {"planks", "tiles", "bricks", "siding", "books", "stripes"}


def textured(
    names: Sequence[str],
    index: np.ndarray,
    local: Vector,
    half: np.ndarray,
    normal: Vector,
    depth: np.ndarray,
) -> np.ndarray:
    """float32 of shape (n,): what the patterns multiply the colours of n points on solids by.

    names : the texture of each solid, "" for none.
    index : int of shape (n,), the solid that each point lies on.
    local, normal : x, y and z, float32 of shape (n,), m, in the solid's own frame.
    half : float32, m, half the height of each solid.
    depth : float32 of shape (n,), m; far away, patterns finer than a pixel fade.
    """
    factors = np.ones(len(index), np.float32)
    numbers = np.array([_NUMBERS[name] if name else -1 for name in names], np.int8)
    codes = numbers[index]
    for code in np.unique(numbers[numbers >= 0]):
        chosen = np.flatnonzero(codes == code)
        if not chosen.size:
            continue
        x, y, z = at(local, chosen)
        nx, ny, nz = map(np.abs, at(normal, chosen))
        level = (nz > nx) & (nz > ny)
        u = np.where((nx >= ny) & (nx >= nz), y, x)
        v = np.where(level, y, z + half[index[chosen]])
        name = _NAMES[code]
        factor = TEXTURES[name](u, v)
        if name in ("facade", "house front"):  # a flat roof has no windows
            factor = np.where(level, 1.0, factor)
        if name in _FINE:
            factor = 0.96 + (factor - 0.96) / (1 + (depth[chosen] / 9) ** 4)
        factors[chosen] = factor
    return factors
