"""How one image's relative depth fits its ground truth: the least-squares and the median fit."""

import numpy as np


def inverse_fit(y: np.ndarray, depth: np.ndarray) -> tuple[float, float] | None:
    """Scale and shift that minimise the sum of (scale * y + shift - 1 / depth)^2.

    y : float array of shape (n,), relative depth; depth : float array of shape (n,), m, positive.
    Returns (scale in 1/m per unit of y, shift in 1/m), either may be negative; None when fewer
    than two different values of y leave the scale open. Closed form in float64, centred, so that
    a large mean of y costs no digits.
    """
    y, inverse = np.asarray(y, np.float64), 1.0 / np.asarray(depth, np.float64)
    if len(y) < 2 or y.min() == y.max():
        return None
    y_mean, inverse_mean = y.mean(), inverse.mean()
    centred = y - y_mean
    # Sums, not BLAS: its threads would change the last bits, and with them the part's bytes.
    scale = np.sum(centred * (inverse - inverse_mean)) / np.sum(centred * centred)
    return float(scale), float(inverse_mean - scale * y_mean)


def median_scale(y: np.ndarray, depth: np.ndarray) -> float | None:
    """Median of the depth over the median of 1 / y, over the pixels with y above 0.

    y : float array of shape (n,); depth : float array of shape (n,), m. Returns m times the unit
    of y, so that median_scale / y is metric; None when no y is positive. 1 / y is undefined at
    the other pixels, so neither median counts them.
    """
    y, depth = np.asarray(y, np.float64), np.asarray(depth, np.float64)
    positive = y > 0
    if not positive.any():
        return None
    return float(np.median(depth[positive]) / np.median(1.0 / y[positive]))
