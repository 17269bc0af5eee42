"""The measures of metric depth that the field reports, one object each.

A metric is an object here or elsewhere, and a line in registry.METRICS or a name in RSA_DATA_CODE;
columns of the metrics table, summaries, reports and exports follow from known_metrics.py.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from ..common.errors import RsaDataError


class Pixels:
    """Valid and clipped pixels of one image, and what several metrics make of them.

    gt, pred : float64 (n,), m, above 0.
    """

    def __init__(self, gt: np.ndarray, pred: np.ndarray):
        self.gt, self.pred = gt, pred

    @cached_property
    def difference(self) -> np.ndarray:
        """pred - gt, m."""
        return np.asarray(self.pred - self.gt)

    @cached_property
    def ratio(self) -> np.ndarray:
        """max(gt / pred, pred / gt)."""
        ratio = self.pred / self.gt
        other = 1.0 / ratio
        return np.asarray(np.maximum(ratio, other, out=other))

    @cached_property
    def log(self) -> np.ndarray:
        """ln pred - ln gt."""
        log = np.log(self.pred)
        return np.asarray(np.subtract(log, np.log(self.gt), out=log))

    @cached_property
    def relative(self) -> np.ndarray:
        """(pred - gt) / gt."""
        return np.asarray(self.difference / self.gt)

    @cached_property
    def square_log(self) -> float:
        """Mean of the squares of log."""
        return float(np.mean(self.log * self.log))


@dataclass(frozen=True)
class Metric:
    """A measure of one image's predicted depth.

    name : of its column. title : how tables head it, without unit and direction.
    formula : in words, with gt and pred in m. unit : "" for a plain number.
    better : higher or lower. source : who defined it.
    of : pixels -> the number. digits : decimals in tables. short : whether narrow tables show it.
    """

    name: str
    title: str
    formula: str
    better: Literal["higher", "lower"]
    source: str
    of: Callable[[Pixels], Any]
    unit: str = ""
    digits: int = 3
    short: bool = False

    @property
    def heading(self) -> str:
        """Title with the direction that is better."""
        return f"{self.title} {'↑' if self.better == 'higher' else '↓'}"

    @property
    def __doc__(self) -> str | None:  # type: ignore[override]
        unit = f", {self.unit}" if self.unit else ""
        return f"{self.title}: {self.formula}{unit} ({self.better} is better; {self.source})."


_EIGEN = "Eigen et al. 2014"


def _delta(power: int, short: bool = False) -> Metric:
    """share of pixels with max(gt / pred, pred / gt) below a power of 1.25"""
    return Metric(
        f"delta{power}",
        f"δ{power}",
        f"share of pixels with max(gt / pred, pred / gt) below 1.25^{power}",
        "higher",
        "Ladicky et al. 2014",
        lambda p: np.count_nonzero(p.ratio < 1.25**power) / len(p.ratio),
        short=short,
    )


DELTA1 = _delta(1, short=True)
DELTA2 = _delta(2)
DELTA3 = _delta(3)
ABS_REL = Metric(
    "abs_rel",
    "AbsRel",
    "mean of |gt - pred| / gt",
    "lower",
    _EIGEN,
    lambda p: np.mean(np.abs(p.relative)),
    short=True,
)
SQ_REL = Metric(
    "sq_rel",
    "SqRel",
    "mean of (gt - pred)^2 / gt",
    "lower",
    _EIGEN,
    lambda p: np.mean(p.relative * p.difference),
    unit="m",
)
RMSE = Metric(
    "rmse",
    "RMSE",
    "root of the mean of (gt - pred)^2",
    "lower",
    _EIGEN,
    lambda p: np.sqrt(np.mean(p.difference * p.difference)),
    unit="m",
    short=True,
)
RMSE_LOG = Metric(
    "rmse_log",
    "RMSElog",
    "root of the mean of (ln gt - ln pred)^2",
    "lower",
    _EIGEN,
    lambda p: np.sqrt(p.square_log),
)
LOG10 = Metric(
    "log10",
    "log10",
    "mean of |log10 gt - log10 pred|",
    "lower",
    "Saxena et al. 2009",
    lambda p: np.mean(np.abs(p.log)) / np.log(10),
    short=True,
)
SILOG = Metric(
    "silog",
    "SILog",
    "standard deviation of ln pred - ln gt, times 100",
    "lower",
    f"{_EIGEN}; KITTI benchmark",
    # Rounding can leave a tiny negative variance where all pixels are off by one factor.
    lambda p: 100 * np.sqrt(max(p.square_log - p.log.mean() ** 2, 0.0)),
    digits=2,
    short=True,
)


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
    from .known_metrics import metrics  # which imports what stands here

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
        raise RsaDataError(
            f"depth_errors: expected an array of numbers; found {type(values).__name__}"
        ) from error
