"""Errors of one image's predicted depth by every metric there is."""

from typing import Any

import numpy as np

from ..common.errors import RsaDataError
from .known_metrics import metrics
from .metrics import Pixels


def depth_errors(
    gt: Any,
    pred: Any,
    *,
    min_depth: float | None = None,
    max_depth: float | None = None,
    protocol: str | None = None,
    dataset: str | None = None,
) -> dict[str, float]:
    """Errors of one image's predicted depth over its valid pixels (Eigen et al. 2014, KITTI).

    Parameters
    ----------
    gt : array or tensor of any shape, m. Pixels with min_depth < gt < max_depth are valid, as in
        the code of BTS and RSA; all others (0, nan, inf too) are left out.
    pred : array or tensor of the same shape, m. Clipped to the range first: inf becomes max_depth
        and nan min_depth.
    min_depth, max_depth : m, 0 < min_depth < max_depth; in place of a protocol's, or without one.
    protocol, dataset : crop, range and scaling of a published table, such as rsa and nyuv2; gt and
        pred are then whole maps of shape (height, width).

    Returns
    -------
    delta1, delta2, delta3 : share of pixels with max(gt / pred, pred / gt) < 1.25, 1.25^2, 1.25^3.
    abs_rel : mean of |gt - pred| / gt.
    sq_rel : mean of (gt - pred)^2 / gt, m.
    rmse : m. rmse_log : of natural logarithms. log10 : mean of |log10 gt - log10 pred|.
    silog : standard deviation of log pred - log gt, times 100.
    Any further metric of the registry by its name.

    Raises RsaDataError when the shapes differ, the range is empty or no pixel is valid. Average
    over images, not over the pixels of all images, to compare with published tables.
    """
    gt, pred = as_array(gt), as_array(pred)
    if gt.shape != pred.shape:
        raise RsaDataError(
            f"depth_errors: expected one shape, found gt {gt.shape} and pred {pred.shape}"
        )
    valid = np.ones(gt.shape, bool)
    if protocol is not None or dataset is not None:
        from .protocols import of_names

        rules = of_names(protocol, dataset)
        if gt.ndim != 2:
            raise RsaDataError(f"depth_errors: expected maps (height, width), found {gt.shape}")
        valid = rules.region(*gt.shape)
        min_depth = rules.min_depth if min_depth is None else min_depth
        max_depth = rules.max_depth if max_depth is None else max_depth
    if min_depth is None or max_depth is None:
        raise RsaDataError(
            "depth_errors: expected min_depth and max_depth, or protocol and dataset"
        )
    if not 0 < min_depth < max_depth:
        raise RsaDataError(
            f"depth_errors: expected 0 < min_depth < max_depth, found {min_depth} and {max_depth}"
        )
    valid &= (gt > min_depth) & (gt < max_depth)
    if not valid.any():
        raise RsaDataError(
            f"depth_errors: no valid pixel: no ground truth between {min_depth} and {max_depth} m"
        )
    gt, pred = gt[valid], pred[valid]
    if protocol is not None and rules.median_scaled:
        pred = pred * (np.median(gt) / np.median(pred))
    return errors_of_valid(gt, clip(pred, min_depth, max_depth))


def errors_of_valid(gt: np.ndarray, pred: np.ndarray) -> dict[str, float]:
    """The same for float64 arrays of shape (n,) that hold valid and clipped pixels only, m."""

    pixels = Pixels(gt, pred)
    return {name: float(metric.of(pixels)) for name, metric in metrics().items()}


def clip(pred: np.ndarray, min_depth: float, max_depth: float) -> np.ndarray:
    """Depths brought into the range, m: inf becomes max_depth, nan min_depth; float64."""
    pred = np.clip(np.asarray(pred, np.float64), min_depth, max_depth)
    np.copyto(pred, min_depth, where=np.isnan(pred))
    return pred


def as_array(values: Any) -> np.ndarray:
    """A torch tensor (of any device) or an array-like as a float64 array."""
    if hasattr(values, "detach"):
        values = values.detach().cpu().double().numpy()
    try:
        return np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        what = type(values).__name__
        raise RsaDataError(f"depth_errors: expected an array of numbers; found {what}") from error
