"""A head's scale and shift, corrected by known distances."""

import numpy as np

from .known_depth import WRONG, agreeing, check_points

# How far a head's scale and shift are off, relative to themselves, when the head does not say.
PRIOR = {"scale": 0.3, "shift": 0.3, "correlation": 0.0}
# Relative error of a known distance: a tape measure on a pixel of a relative-depth map, whose own
# error is of this order (the linear fit's AbsRel on NYU is .058 with Depth Anything).
POINT_ERROR = 0.06


def refine(
    scale: float,
    shift: float,
    y: np.ndarray,
    metres: np.ndarray,
    prior: dict[str, float] | None = None,
    point_error: float = POINT_ERROR,
) -> tuple[float, float]:
    """Scale and shift that go between a head's prediction and points of known depth.

    Least squares in inverse depth with the prediction as the prior: minimises
    sum_k ((a y_k + b - 1 / z_k) z_k / point_error)^2 + e' C^-1 e over a, b >= 0, where
    e = ((a - scale) / scale, (b - shift) / shift) and C is the prior's covariance. No point gives
    the prediction itself; many points give their weighted least squares.

    y, metres : float (k,), relative depth at the points, and their depth, m, above 0.
    prior : standard deviations of the relative errors of scale and shift and their correlation.
    """
    prior = prior or PRIOR
    check_points(y, metres)
    whiten = _whitener(scale, shift, prior)
    rows = np.stack([y, np.ones_like(y)], 1) * (metres / point_error)[:, None]
    matrix = np.concatenate([rows, whiten])
    target = np.concatenate([np.full(len(y), 1 / point_error), whiten @ [scale, shift]])
    a, b = np.linalg.lstsq(matrix, target, rcond=None)[0]
    # Neither may be negative: that one is 0 and the other the best beside it.
    if a < 0:
        a, b = 0.0, (matrix[:, 1] @ target) / (matrix[:, 1] @ matrix[:, 1])
    elif b < 0:
        a, b = (matrix[:, 0] @ target) / (matrix[:, 0] @ matrix[:, 0]), 0.0
    return float(a), float(b)


def _whitener(scale: float, shift: float, prior: dict[str, float]) -> np.ndarray:
    """(2, 2): times how far scale and shift are off, it has the prior's cost as its square."""
    both = prior["correlation"] * prior["scale"] * prior["shift"]
    covariance = np.array([[prior["scale"] ** 2, both], [both, prior["shift"] ** 2]])
    found: np.ndarray = np.linalg.cholesky(np.linalg.inv(covariance)).T / np.array([scale, shift])
    return found


def correct(
    scale: float,
    shift: float,
    y: np.ndarray,
    metres: np.ndarray,
    prior: dict[str, float] | None = None,
) -> tuple[float, float, np.ndarray]:
    """`refine`, without points that contradict the head and the other points: a, b, used bool (k,).

    Minimises the cost of `refine` with each point's share of it capped where the point misses by
    25% (truncated least squares), so that one wrong distance moves nothing, by alternating between
    the fit and the choice of points, begun from all of them, from those that agree with each other
    and from those nearest the head. More than half of the points stay, of two at least one: known
    distances that agree are believed against the head.
    """
    check_points(y, metres)
    if len(y) < 2:
        return *refine(scale, shift, y, metres, prior), np.ones(len(y), bool)
    least = len(y) // 2 + 1 if len(y) > 2 else 1
    whiten = _whitener(scale, shift, prior or PRIOR)

    def misses(a: float, b: float) -> np.ndarray:
        found: np.ndarray = np.abs((a * y + b) * metres - 1)
        return found

    def chosen(error: np.ndarray) -> np.ndarray:
        used = error <= WRONG
        if used.sum() < least:
            used[np.argsort(error, kind="stable")[:least]] = True
        return used

    ends = []
    for used in (np.ones(len(y), bool), agreeing(y, metres), chosen(misses(scale, shift))):
        for _ in range(20):
            a, b = refine(scale, shift, y[used], metres[used], prior)
            error = misses(a, b)
            if (used == (used := chosen(error))).all():
                break
        capped = np.where(used, error, np.minimum(error, WRONG)) / POINT_ERROR
        off = whiten @ [a - scale, b - shift]
        ends.append((float(capped @ capped + off @ off), a, b, used))
    return min(ends, key=lambda end: end[0])[1:]
