"""The measures of metric depth that the field reports, one object each.

A metric is an object here or elsewhere, and a line in registry.METRICS or a name in RSA_DATA_CODE;
columns of the metrics table, summaries, reports and exports follow from known_metrics.py.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np


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
