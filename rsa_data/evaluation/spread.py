"""The spread over an image's caption variants as an error bar, and whether it tells the truth."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..common.errors import RsaDataError
from ..heads.belong import Source
from .inputs import Image, TestPart
from .oracles import metric
from .protocols import Rules


@dataclass(frozen=True)
class Spread:
    """One number an image, float64 of shape (n,).

    bar : standard deviation over variants of the logarithm of the depth predicted at the image's
        median y. error : logarithm of the plain caption's depth there over the true depth, the
        median of the ground truth over the tenth of the pixels whose y is nearest the median.
    """

    sample_id: Sequence[str]
    bar: np.ndarray
    error: np.ndarray


def spread(
    parts: Sequence[TestPart],
    head: Callable[[np.ndarray], tuple[Any, Any]],
    source: Source,
    rules: Rules,
    variants: Sequence[int],
) -> Spread:
    """The spread of a head's predictions over caption variants, with the plain one's error.

    variants : which of them make the spread, such as 1 to 4; at least two.
    """
    if len(variants) < 2:
        raise RsaDataError(
            f"{source.captions}: expected at least 3 variants a caption (the plain one and two "
            f"more) to measure a spread; found {1 + len(variants)}. Write them with --variants"
        )
    ids, bars, errors = [], [], []
    for part in parts:
        found = [part.seen(source, v) for v in (0, *variants)]
        there = np.all([has for _, has in found], axis=0)
        pairs = [head(features) for features, _ in found]
        scales = np.array([np.asarray(scale) for scale, _ in pairs], np.float64)  # (v, n)
        shifts = np.array([np.asarray(shift) for _, shift in pairs], np.float64)  # (v, n)
        for sample, image in part.images(rules):
            if not isinstance(image, Image) or not there[image.row]:
                continue
            y = float(np.median(image.y))
            near = np.argsort(np.abs(image.y - y), kind="stable")[: max(1, len(image.y) // 10)]
            low, high = rules.min_depth, rules.max_depth
            depth = np.array(
                [
                    np.clip(metric(np.array([y]), s, t)[0], low, high)
                    for s, t in zip(scales[:, image.row], shifts[:, image.row], strict=True)
                ]
            )
            ids.append(sample["sample_id"])
            bars.append(np.std(np.log(depth[1:]), ddof=1))
            errors.append(np.log(depth[0] / np.median(image.gt[near])))
    return Spread(ids, np.array(bars), np.array(errors))


def calibration(found: Spread, bins: int = 5) -> list[dict[str, float]]:
    """Mean error bar and root mean square error in groups of equal size, smallest bars first.

    A bar that tells the truth has both equal in every group. Rows: images, bar, error.
    """
    order = np.argsort(found.bar, kind="stable")
    return [
        {
            "images": len(rows),
            "bar": float(np.mean(found.bar[rows])),
            "error": float(np.sqrt(np.mean(found.error[rows] ** 2))),
        }
        for rows in np.array_split(order, min(bins, len(order)))
        if len(rows)
    ]


def inflation(found: Spread) -> float:
    """What the bars must be multiplied by so that, over all images, they equal the errors."""
    bar = float(np.sqrt(np.mean(found.bar**2)))
    return float(np.sqrt(np.mean(found.error**2))) / bar if bar else float("inf")


def rank_correlation(found: Spread) -> float:
    """Spearman's correlation of bar and absolute error; 0 says the bar knows nothing."""
    ranks = [np.argsort(np.argsort(v)).astype(float) for v in (found.bar, np.abs(found.error))]
    if len(found.bar) < 2 or np.ptp(found.bar) == 0:
        return 0.0
    return float(np.corrcoef(ranks)[0, 1])
