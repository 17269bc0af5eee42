"""What faster arithmetic changes: features of a sample compared with float32, within limits."""

from pathlib import Path

import numpy as np

from ..common.errors import RsaDataError
from ..registry import UPWARDS, resolve

# Beyond these the step stops. A cosine says little of what a head makes of a feature (at .998 the
# released Depth Anything head's scale moved by 1.6% in the median, 4 to 5% in the worst twentieth),
# and nothing of its norm, hence three limits.
MIN_COSINE = 0.995
MAX_NORM_CHANGE = 0.02
MAX_HEAD_CHANGE = 0.05  # 95th percentile over the sample, of scale and of shift

# Texts of the first part that are compared: enough for a 95th percentile. Of the other parts a
# share, which catches what only some texts show.
FIRST, SHARE = 256, 0.01


def sample(count: int, part: int) -> np.ndarray:
    """The rows of a part of `count` texts that are compared, evenly over it."""
    size = min(count, FIRST) if part == 0 else int(np.ceil(SHARE * count))
    return np.unique(np.linspace(0, count - 1, size).astype(np.int64))


def compare(
    found: np.ndarray, exact: np.ndarray, precision: str, head: Path | None = None
) -> dict[str, float]:
    """Figures of the differences, for the receipt.

    found, exact : float32 of shape (n, dim), the same texts at `precision` and in float32.
    head : a trained head; then also what it makes of the differences.

    Raises RsaDataError when a limit above is passed.
    """
    norms = np.linalg.norm(found, axis=1), np.linalg.norm(exact, axis=1)
    cosine = (found * exact).sum(1) / (norms[0] * norms[1])
    figures = {
        "texts": len(found),
        "cosine_min": float(cosine.min()),
        "cosine_median": float(np.median(cosine)),
        "norm_change_max": float(np.abs(norms[0] / norms[1] - 1).max()),
    }
    passed = []
    if not figures["cosine_min"] >= MIN_COSINE:
        passed.append(f"a cosine of {figures['cosine_min']:.4f} (at least {MIN_COSINE})")
    if not figures["norm_change_max"] <= MAX_NORM_CHANGE:
        passed.append(
            f"a norm changed by {figures['norm_change_max']:.1%} (at most {MAX_NORM_CHANGE:.0%})"
        )
    if head is not None:
        loaded = resolve("room", UPWARDS, "scale-head").load(head)
        for name, one, other in zip(("scale", "shift"), loaded(found), loaded(exact), strict=True):
            change = np.abs(one / other - 1)
            figures[f"{name}_change_median"] = float(np.median(change))
            figures[f"{name}_change_p95"] = p95 = float(np.percentile(change, 95))
            if not p95 <= MAX_HEAD_CHANGE:
                passed.append(f"{name} changed by {p95:.1%} (at most {MAX_HEAD_CHANGE:.0%})")
    if passed:
        raise RsaDataError(
            f"embed: --precision {precision} changes the features of this part too much: expected "
            f"the limits in brackets against float32, found {'; '.join(passed)}. Use --precision "
            "float32, or bfloat16 in place of int8"
        )
    return figures
