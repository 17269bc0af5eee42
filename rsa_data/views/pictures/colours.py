"""Numbers to colours that colour-blind people can tell apart too."""

from dataclasses import dataclass

import numpy as np

# Nine evenly spaced colours of matplotlib's viridis (CC0): near is dark, far is bright.
_VIRIDIS = (
    "440154 472d7b 3b528b 2c728e 21918c 28ae80 5ec962 addc30 fde725"
)  # fmt: skip
# ColorBrewer's RdBu, seven classes, reversed (Apache-2.0): blue below 0, red above.
_BLUE_RED = "2166ac 67a9cf d1e5f0 f7f7f7 fddbc7 ef8a62 b2182b"
# Okabe and Ito's palette without black, and lighter and darker kin of it.
_SEGMENTS = (
    "e69f00 56b4e9 009e73 f0e442 0072b2 d55e00 cc79a7 b3b3b3 "
    "8c6200 9ad4f5 66c9a8 8a8300 5aa7d6 f08a4b e8b5d0 6b6b6b"
)  # fmt: skip
NOTHING = (222, 222, 222)

# Percentiles of a map between which its colours differ, and how that is said beside a bar.
_ENDS = (2, 98)
ENDS = "2nd to 98th percentile"
_STEPS = np.array([1, 2, 2.5, 5, 10])
_PARTS = 6  # of a bar, at most about


def _table(colours: str) -> np.ndarray:
    return np.array([[int(c[k : k + 2], 16) for k in (0, 2, 4)] for c in colours.split()], float)


SEGMENT_COLOURS = _table(_SEGMENTS).astype(np.uint8)


@dataclass(frozen=True)
class Range:
    """The depths between which colours differ. ticks : m, evenly spaced, at least two."""

    ticks: tuple[float, ...]

    @property
    def low(self) -> float:
        return self.ticks[0]

    @property
    def high(self) -> float:
        return self.ticks[-1]

    @property
    def labels(self) -> tuple[str, ...]:
        """A label for each tick."""
        return tuple(f"{tick:g} m" for tick in self.ticks)

    def ramp(self, count: int = 256) -> np.ndarray:
        """The colours from low to high, uint8 (count, 3), RGB."""
        low = max(self.low, 1e-9)  # at 0 there is no depth
        colours: np.ndarray = depth_colours(
            np.linspace(low, self.high, count)[None], self.high, self.low
        )[0]
        return colours


def range_of(depth: np.ndarray) -> Range:
    """From the 2nd to the 98th percentile of a map, m, widened to round numbers.

    A few wild pixels do not take the contrast away. What is 0, negative or not finite does not
    count.
    """
    good = depth[np.isfinite(depth) & (depth > 0)]
    if not len(good):
        return Range((0.0, 1.0))
    low, high = (float(value) for value in np.percentile(good, _ENDS))
    high = max(high, 1.02 * low)  # a flat wall
    power = 10.0 ** np.floor(np.log10((high - low) / _PARTS))
    steps = _STEPS * power
    step = float(steps[np.searchsorted(steps, (high - low) / _PARTS * (1 - 1e-6))])
    first, last = int(np.floor(low / step + 1e-6)), int(np.ceil(high / step - 1e-6))
    return Range(tuple(float(f"{k * step:.6g}") for k in range(first, last + 1)))


def depth_colours(depth: np.ndarray, top: float, low: float = 0.0) -> np.ndarray:
    """uint8 (h, w, 3), RGB, of depth (h, w), m: up to `low` dark, from `top` on bright.

    Grey where there is no depth: 0, negative, or not finite.
    """
    there = np.isfinite(depth) & (depth > 0)
    colours = _colours((np.where(there, depth, low) - low) / (top - low), _table(_VIRIDIS))
    return np.where(there[..., None], colours, np.array(NOTHING, np.uint8))


def error_colours(error: np.ndarray, top: float) -> np.ndarray:
    """uint8 (h, w, 3), RGB, of signed errors (h, w): blue at -top, white at 0, red at top.

    Grey where the error is NaN.
    """
    there = np.isfinite(error)
    colours = _colours(np.where(there, error, 0) / (2 * top) + 0.5, _table(_BLUE_RED))
    return np.where(there[..., None], colours, np.array(NOTHING, np.uint8))


def _colours(share: np.ndarray, table: np.ndarray) -> np.ndarray:
    place = np.clip(share, 0, 1) * (len(table) - 1)
    knots = np.arange(len(table))
    channels = [np.interp(place, knots, table[:, k]) for k in range(3)]
    return (np.stack(channels, -1) + 0.5).astype(np.uint8)


def round_up(value: float) -> float:
    """The next of 1, 1.5, 2, 3, 4, 5, 6, 8 times a power of ten: a range that reads well."""
    if not np.isfinite(value) or value <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    steps = np.array([1, 1.5, 2, 3, 4, 5, 6, 8, 10]) * power
    return float(steps[np.searchsorted(steps, value * (1 - 1e-6))])
