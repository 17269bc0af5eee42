"""The measures of metric depth that the field reports."""

from typing import Any

import numpy as np

from ..common.errors import RsaDataError

# delta1 to delta3 and the errors, in the order that tables print them.
METRICS = (
    "delta1",
    "delta2",
    "delta3",
    "abs_rel",
    "sq_rel",
    "rmse",
    "rmse_log",
    "log10",
    "silog",
)


def depth_errors(gt: Any, pred: Any, *, min_depth: float, max_depth: float) -> dict[str, float]:
    """Errors of one image's predicted depth over its valid pixels (Eigen et al. 2014, KITTI).

    Parameters
    ----------
    gt : array or tensor of any shape, m. Pixels with min_depth < gt < max_depth are valid, as in
        the code of BTS and RSA; all others (0, nan, inf too) are left out.
    pred : array or tensor of the same shape, m. Clipped to the range first: inf becomes max_depth
        and nan min_depth.
    min_depth, max_depth : m, 0 < min_depth < max_depth.

    Returns
    -------
    delta1, delta2, delta3 : share of pixels with max(gt / pred, pred / gt) < 1.25, 1.25^2, 1.25^3.
    abs_rel : mean of |gt - pred| / gt.
    sq_rel : mean of (gt - pred)^2 / gt, m.
    rmse : m. rmse_log : of natural logarithms. log10 : mean of |log10 gt - log10 pred|.
    silog : standard deviation of log pred - log gt, times 100.

    Raises RsaDataError when the shapes differ, the range is empty or no pixel is valid. Average
    over images, not over the pixels of all images, to compare with published tables.
    """
    gt, pred = as_array(gt), as_array(pred)
    if gt.shape != pred.shape:
        raise RsaDataError(
            f"depth_errors: expected one shape, found gt {gt.shape} and pred {pred.shape}"
        )
    if not 0 < min_depth < max_depth:
        raise RsaDataError(
            f"depth_errors: expected 0 < min_depth < max_depth, found {min_depth} and {max_depth}"
        )
    valid = (gt > min_depth) & (gt < max_depth)
    if not valid.any():
        raise RsaDataError(
            f"depth_errors: no valid pixel: no ground truth between {min_depth} and {max_depth} m"
        )
    return errors_of_valid(gt[valid], clip(pred[valid], min_depth, max_depth))


def errors_of_valid(gt: np.ndarray, pred: np.ndarray) -> dict[str, float]:
    """The same for float64 arrays of shape (n,) that hold valid and clipped pixels only, m."""
    ratio = pred / gt
    ratio = np.maximum(ratio, 1.0 / ratio)
    difference = pred - gt
    relative = difference / gt
    log = np.log(pred) - np.log(gt)
    log_mean, log_square = log.mean(), np.mean(log * log)
    return {
        "delta1": float(np.mean(ratio < 1.25)),
        "delta2": float(np.mean(ratio < 1.25**2)),
        "delta3": float(np.mean(ratio < 1.25**3)),
        "abs_rel": float(np.mean(np.abs(relative))),
        "sq_rel": float(np.mean(relative * difference)),
        "rmse": float(np.sqrt(np.mean(difference * difference))),
        "rmse_log": float(np.sqrt(log_square)),
        "log10": float(np.mean(np.abs(log)) / np.log(10)),
        # Rounding can leave a tiny negative variance where all pixels are off by one factor.
        "silog": float(100 * np.sqrt(max(log_square - log_mean**2, 0.0))),
    }


def clip(pred: np.ndarray, min_depth: float, max_depth: float) -> np.ndarray:
    """Depths brought into the range, m: inf becomes max_depth, nan min_depth; float64."""
    pred = np.asarray(pred, np.float64)
    return np.clip(np.where(np.isnan(pred), min_depth, pred), min_depth, max_depth)


def as_array(values: Any) -> np.ndarray:
    """A torch tensor (of any device) or an array-like as a float64 array."""
    if hasattr(values, "detach"):
        values = values.detach().cpu().double().numpy()
    return np.asarray(values, np.float64)
