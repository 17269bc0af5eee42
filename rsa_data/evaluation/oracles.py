"""What an image's own ground truth could make of its relative depth: fits that cheat, as bounds."""

from functools import cached_property

import numpy as np

from ..depth.fits import inverse_fit, median_scale


def metric(y: np.ndarray, scale: float, shift: float) -> np.ndarray:
    """1 / (scale * y + shift) in float64, m; inf where that is not positive, as to_metric says."""
    inverse = scale * np.asarray(y, np.float64) + shift
    with np.errstate(divide="ignore"):
        return np.where(inverse > 0, 1.0 / inverse, np.inf)


def median(y: np.ndarray, gt: np.ndarray) -> tuple[float, float] | None:
    """Scale of the median oracle and a shift of 0; None when no y is positive."""
    factor = median_scale(y, gt)
    return None if factor is None else (1.0 / factor, 0.0)


def inverse_least_squares(y: np.ndarray, gt: np.ndarray) -> tuple[float, float] | None:
    """The paper's linear fit: least squares of 1 / gt on y; see depth.fits.inverse_fit."""
    return inverse_fit(y, gt)


class Fits:
    """The fits of an image's relative depth to its own ground truth, each made once.

    y, gt : float64 of shape (n,), gt in m.
    """

    def __init__(self, y: np.ndarray, gt: np.ndarray):
        self.y, self.gt = y, gt

    @cached_property
    def median(self) -> tuple[float, float] | None:
        return median(self.y, self.gt)

    @cached_property
    def linear(self) -> tuple[float, float] | None:
        return inverse_least_squares(self.y, self.gt)

    def in_depth(self, max_depth: float) -> tuple[float, float] | None:
        return depth_least_squares(self.y, self.gt, max_depth, starts=(self.linear, self.median))


def depth_least_squares(
    y: np.ndarray,
    gt: np.ndarray,
    max_depth: float,
    most: int = 100,
    starts: tuple[tuple[float, float] | None, ...] | None = None,
) -> tuple[float, float] | None:
    """Scale and shift that minimise the sum of (d - gt)^2 in m^2, d = 1 / (scale * y + shift).

    The model is the head's own, capped: d is max_depth where it would be more, or where
    scale * y + shift is not positive. Levenberg-Marquardt in float64, begun from the better of
    the two fits above, so it is never worse than they are. `most` bounds its steps.

    y, gt : arrays of shape (n,), gt in m. starts : the two fits, where they are known already.
    None when both other fits are None.
    """
    y, gt = np.asarray(y, np.float64), np.asarray(gt, np.float64)
    found = [f for f in starts or (inverse_fit(y, gt), median(y, gt)) if f is not None]
    if not found:
        return None
    centre = y.mean()
    x = y - centre
    floor = 1.0 / max_depth
    # A new array of this size costs more than what is computed in it.
    inverse, depth, slope, along, product, r, r_next = np.empty((7, len(x)))

    def residual(p: np.ndarray, out: np.ndarray) -> float:
        """The sum of squares of what is left; `inverse` and `depth` are then those of p."""
        np.add(np.multiply(p[0], x, out=inverse), p[1], out=inverse)
        np.divide(1.0, np.maximum(inverse, floor, out=depth), out=depth)
        np.subtract(depth, gt, out=out)
        return total(out, out)

    def total(u: np.ndarray, v: np.ndarray) -> float:
        return float(np.sum(np.multiply(u, v, out=product)))

    p = min((np.array([s, t + s * centre]) for s, t in found), key=lambda p: residual(p, r))
    now, damping = residual(p, r), 1e-3
    for _ in range(most):
        np.negative(np.multiply(depth, depth, out=slope), out=slope)
        np.copyto(slope, 0.0, where=~(inverse > floor))
        np.multiply(slope, x, out=along)  # with slope, the two columns of the Jacobian
        aa, ab, bb = (total(u, v) for u, v in ((along, along), (along, slope), (slope, slope)))
        normal, gradient = np.array([[aa, ab], [ab, bb]]), [total(along, r), total(slope, r)]
        while damping < 1e12:
            diagonal = np.diag(np.maximum(np.diag(normal), 1e-30) * damping)
            step = -np.linalg.solve(normal + diagonal, gradient)
            then = residual(p + step, r_next)
            if then < now:
                break
            damping *= 10
        else:
            break
        small = bool(np.all(np.abs(step) <= 1e-9 * np.abs(p)))
        p, r, r_next, damping = p + step, r_next, r, max(damping / 10, 1e-12)
        now = then
        if small:
            break
    return float(p[0]), float(p[1] - p[0] * centre)
