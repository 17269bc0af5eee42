"""Differences between methods on the same images, with intervals by scene."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from .summary import interval


@dataclass(frozen=True)
class Difference:
    """A method's AbsRel less another's, over the images that both could do.

    images, scenes : how many; ahead : in how many of the scenes its mean is smaller. mean : of the
    differences; ratio : of the two means. low, high : 95% interval of the mean difference, None
    where all images are of one scene.
    """

    dataset: str
    method: str
    against: str
    images: int
    scenes: int
    ahead: int
    mean: float
    ratio: float
    low: float | None
    high: float | None

    @property
    def line(self) -> str:
        """A row of text."""
        bounds = "" if self.low is None else f" [{self.low:+.3f}, {self.high:+.3f}]"
        return (
            f"{self.dataset}: {self.method} less {self.against}: {self.mean:+.3f}{bounds}, "
            f"{self.ratio:.2f} of it, ahead in {self.ahead} of {self.scenes} scenes"
        )


def differences(metrics: pd.DataFrame, against: str, draws: int) -> list[Difference]:
    """Each method's AbsRel less that of `against`, by dataset, in the order of the table.

    metrics : a metrics table, one row for each image and method. The differences of an image's two
    errors vary far less than the errors, so these intervals tell methods apart where each one's own
    interval does not. draws : of the bootstrap over scenes, see `summary.interval`.
    """
    good = metrics[metrics["status"] == "ok"]
    found: list[Difference] = []
    for dataset, rows in good.groupby("dataset", sort=False):
        errors = rows.pivot_table("abs_rel", ["scene", "sample_id"], "method", sort=False)
        zero = f"{against} (zero-shot)"
        base = zero if against not in errors and zero in errors else against
        if base not in errors:
            continue
        for method in dict.fromkeys(rows["method"]):
            if method != base:
                both = errors[[method, base]].dropna()
                found += _difference(str(dataset), method, base, both, draws)
    return found


def _difference(
    dataset: str, method: str, against: str, both: pd.DataFrame, draws: int
) -> Sequence[Difference]:
    if not len(both):
        return []
    values = (both[method] - both[against]).to_numpy(np.float64)
    scenes = both.index.get_level_values("scene").to_numpy()
    low, high = interval(values[:, None], scenes, draws)
    return [
        Difference(
            dataset=dataset,
            method=method,
            against=against,
            images=len(values),
            scenes=len(set(scenes)),
            ahead=int((pd.Series(values).groupby(scenes).mean() < 0).sum()),
            mean=float(values.mean()),
            ratio=float(both[method].mean() / both[against].mean()),
            low=float(low[0]) if len(low) else None,
            high=float(high[0]) if len(high) else None,
        )
    ]


def to_csv(rows: Sequence[Difference]) -> str:
    """Every number in full."""
    content: str = pd.DataFrame([vars(row) for row in rows]).to_csv(
        index=False, lineterminator="\n"
    )
    return content
