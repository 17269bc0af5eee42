"""Means over images, with intervals that know that frames of one scene are not independent."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from ..datasets import labels
from .known_metrics import metrics


@dataclass(frozen=True)
class Row:
    """One method on one dataset.

    images : how many were measured; failed : how many were not, though there was ground truth.
    synthetic : whether the images were rendered.
    mean : of each metric over the images. low, high : bounds of its 95% interval, empty when all
        images are of one scene.
    """

    dataset: str
    method: str
    images: int
    failed: int
    scenes: int
    mean: dict[str, float]
    low: dict[str, float]
    high: dict[str, float]
    synthetic: bool = False

    @property
    def shown(self) -> str:
        """Name of the dataset as tables for people give it."""
        return labels.shown(self.dataset, self.synthetic)


def summarise(
    table: pa.Table, draws: int = 1000, seed: int = 0, synthetic: Collection[str] = ()
) -> list[Row]:
    """Rows of a metrics table's datasets and methods, in the order in which they first appear.

    draws : of the bootstrap of `interval`; 0 for no intervals. synthetic : datasets that were
    rendered.
    """
    frame = table.select(["dataset", "scene", "method", "status", *metrics()]).to_pandas()
    rows = []
    for (dataset, method), group in frame.groupby(["dataset", "method"], sort=False):
        good = group[group["status"] == "ok"]
        values = good[list(metrics())].to_numpy(np.float64)
        scenes = good["scene"].to_numpy()
        low, high = interval(values, scenes, draws, seed)
        rows.append(
            Row(
                dataset=dataset,
                method=method,
                images=len(good),
                failed=int((group["status"] == "failed").sum()),
                scenes=len(set(scenes)),
                mean=_named(values.mean(0)) if len(good) else {},
                low=_named(low),
                high=_named(high),
                synthetic=dataset in synthetic,
            )
        )
    return rows


def no_better(dataset: str, errors: Mapping[str, float], method: str) -> str | None:
    """A sentence where a head's AbsRel is not below a constant's; errors : AbsRel by method."""
    constants = [errors[name] for name in ("constant", "constant (L1)") if name in errors]
    if method not in errors or not constants or min(constants) > errors[method]:
        return None
    return (
        f"{dataset}: {method} does not beat a constant scale and shift in AbsRel: what it reads "
        "told it nothing that helps here."
    )


def few_scenes(dataset: str, scenes: int, images: int) -> list[str]:
    """What so few scenes cannot show, in words; nothing where there are 30 or more.

    A method that is no better than another is ahead in all of n scenes, or behind in all, with
    probability 2 / 2^n (sign test). With less than about 30 clusters the intervals of a cluster
    bootstrap are too narrow (Cameron, Gelbach and Miller 2008).
    """
    if scenes == 1:
        return [f"{dataset}: one scene only, so nothing is said about others; no interval."]
    if not 1 < scenes < 30:
        return []
    chance = 2 / 2**scenes
    said = f"{dataset}: {images} images of only {scenes} scenes: the intervals are too narrow"
    if chance <= 0.05:
        return [f"{said}, so take small differences between rows for chance."]
    return [
        f"{said}, and no difference between two rows can be significant: of two methods that are "
        f"equally good, one is ahead in all {scenes} scenes by chance in {chance:.0%} of cases. "
        "This shows that the chain runs on such images and how large the errors are about; it does "
        "not show which input is better."
    ]


def interval(
    values: np.ndarray, scenes: np.ndarray, draws: int = 1000, seed: int = 0, level: float = 0.95
) -> tuple[np.ndarray, np.ndarray]:
    """Percentile interval of the mean over images, whole scenes drawn with replacement.

    values : float64 of shape (n, m); scenes : n names. Frames of one scene resemble each other, so
    drawing single images would make intervals several times too narrow (cluster bootstrap, Field
    and Welsh 2007). Returns the lower and upper bounds, each of shape (m,), or of shape (0,) where
    there are fewer than two scenes or no draws.
    """
    names, of = np.unique(scenes.astype(str), return_inverse=True)
    if len(names) < 2 or not draws:
        return np.empty(0), np.empty(0)
    sums = np.zeros((len(names), values.shape[1]))
    np.add.at(sums, of, values)
    counts = np.bincount(of)
    generator = np.random.Generator(np.random.Philox(seed))
    drawn = generator.multinomial(len(names), np.full(len(names), 1 / len(names)), draws)  # (d, s)
    means = (drawn @ sums) / (drawn @ counts)[:, None]  # (d, m)
    low, high = np.quantile(means, [(1 - level) / 2, (1 + level) / 2], axis=0)
    return low, high


def _named(values: np.ndarray) -> dict[str, float]:
    return dict(zip(metrics(), values.tolist(), strict=False))
