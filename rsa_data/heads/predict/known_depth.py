"""A prediction from words, corrected by what else is known: points, a range, the frames around."""

from collections.abc import Sequence

import numpy as np

from ...common.errors import UsageError

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
    if not (np.isfinite(y).all() and (metres > 0).all() and np.isfinite(metres).all()):
        raise UsageError(
            f"known points: expected depths above 0 m where the relative depth is defined; found "
            f"depths {metres.tolist()} at relative depths {y.tolist()}"
        )
    both = prior["correlation"] * prior["scale"] * prior["shift"]
    covariance = np.array([[prior["scale"] ** 2, both], [both, prior["shift"] ** 2]])
    whiten = np.linalg.cholesky(np.linalg.inv(covariance)).T / np.array([scale, shift])
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


def points(relative: np.ndarray, known: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """y and depth (m) of points written as `u,v,metres`: column, row from the top left in px."""
    y, metres = [], []
    height, width = relative.shape
    for text in known:
        try:
            u, v, depth = (float(number) for number in text.split(","))
        except ValueError as error:
            raise UsageError(f"--known: expected u,v,metres; found {text!r}") from error
        if not (0 <= u < width and 0 <= v < height):
            raise UsageError(
                f"--known {text}: expected a pixel of the relative depth, {width} x {height}"
            )
        y.append(float(relative[int(v), int(u)]))
        metres.append(depth)
    return np.array(y), np.array(metres)


def ends(relative: np.ndarray, near_far: str) -> tuple[np.ndarray, np.ndarray]:
    """The nearest and farthest point as known ones, from `near,far` in m.

    The 1st and 99th percentile stand for them: single pixels at the ends are often wrong.
    """
    try:
        near, far = (float(number) for number in near_far.split(","))
    except ValueError as error:
        raise UsageError(f"--range: expected near,far in metres; found {near_far!r}") from error
    if not 0 < near < far:
        raise UsageError(f"--range: expected 0 < near < far; found {near_far}")
    values = relative[np.isfinite(relative)]
    if not len(values):
        raise UsageError("--range: the relative depth is defined nowhere")
    return np.percentile(values, [99, 1]), np.array([near, far])


def smooth(values: np.ndarray, frames: int) -> np.ndarray:
    """Geometric mean over a window of `frames` frames around each, fewer at the ends.

    values : float (n,), above 0, one a frame in order of time. A head's errors are factors, so it
    is the logarithms that are averaged.
    """
    half = frames // 2
    logs = np.concatenate([[0.0], np.cumsum(np.log(values, dtype=np.float64))])
    index = np.arange(len(values))
    first, last = np.maximum(index - half, 0), np.minimum(index + half + 1, len(values))
    return np.exp((logs[last] - logs[first]) / (last - first)).astype(np.float32)


def camera(text: str) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy in px, written with commas between."""
    try:
        fx, fy, cx, cy = (float(number) for number in text.split(","))
    except ValueError as error:
        raise UsageError(f"--intrinsics: expected fx,fy,cx,cy in px; found {text!r}") from error
    return fx, fy, cx, cy
