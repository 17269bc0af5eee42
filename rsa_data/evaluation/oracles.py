"""What an image's own ground truth could make of its relative depth: fits that cheat, as bounds."""

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


def depth_least_squares(
    y: np.ndarray, gt: np.ndarray, max_depth: float, most: int = 100
) -> tuple[float, float] | None:
    """Scale and shift that minimise the sum of (d - gt)^2 in m^2, d = 1 / (scale * y + shift).

    The model is the head's own, capped: d is max_depth where it would be more, or where
    scale * y + shift is not positive. Levenberg-Marquardt in float64, begun from the better of
    the two fits above, so it is never worse than they are. `most` bounds its steps.

    y, gt : arrays of shape (n,), gt in m. None when both other fits are None.
    """
    y, gt = np.asarray(y, np.float64), np.asarray(gt, np.float64)
    starts = [fit for fit in (inverse_fit(y, gt), median(y, gt)) if fit is not None]
    if not starts:
        return None
    centre = y.mean()
    x = y - centre
    floor = 1.0 / max_depth

    def residual(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        inverse = p[0] * x + p[1]
        depth = 1.0 / np.maximum(inverse, floor)
        return depth - gt, np.where(inverse > floor, -depth * depth, 0.0)

    def cost(p: np.ndarray) -> float:
        r = residual(p)[0]
        return float(np.sum(r * r))

    p = min((np.array([s, t + s * centre]) for s, t in starts), key=cost)
    r, slope = residual(p)
    now, damping = float(np.sum(r * r)), 1e-3
    for _ in range(most):
        along = slope * x  # with slope, the two columns of the Jacobian
        aa, ab, bb = (np.sum(u * v) for u, v in ((along, along), (along, slope), (slope, slope)))
        normal, gradient = np.array([[aa, ab], [ab, bb]]), [np.sum(along * r), np.sum(slope * r)]
        while damping < 1e12:
            diagonal = np.diag(np.maximum(np.diag(normal), 1e-30) * damping)
            step = -np.linalg.solve(normal + diagonal, gradient)
            r_next, slope_next = residual(p + step)
            then = float(np.sum(r_next * r_next))
            if then < now:
                break
            damping *= 10
        else:
            break
        small = bool(np.all(np.abs(step) <= 1e-9 * np.abs(p)))
        p, r, slope, damping = p + step, r_next, slope_next, max(damping / 10, 1e-12)
        now = then
        if small:
            break
    return float(p[0]), float(p[1] - p[0] * centre)
