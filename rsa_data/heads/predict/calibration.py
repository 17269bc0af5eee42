"""How far a head can be trusted: what it has seen, and how far off it was on validation."""

from typing import Any

import numpy as np

from ..checkpoint import ScaleHead
from ..description import Prior
from ..train.examples import Examples

# Texts that stand for all texts of the training set, to measure from.
REFERENCES = 1024
# Distinct class names of objects that are kept at most; LVIS, the longest list here, has 1,203.
NAMES = 4096


def references(parts: list[np.ndarray]) -> np.ndarray:
    """At most REFERENCES features, float16 (m, dim), spread evenly over those of all parts."""
    features = np.concatenate(parts)
    rows = np.linspace(0, len(features) - 1, min(len(features), REFERENCES)).astype(int)
    found: np.ndarray = features[rows].astype(np.float16)
    return found


def names(parts: list[np.ndarray]) -> np.ndarray | None:
    """Each distinct row of those of all parts, float16 (m, dim); None where they are too many."""
    found = np.unique(np.concatenate(parts).astype(np.float16), axis=0)
    return found if len(found) <= NAMES else None


def distance(features: np.ndarray, references: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """1 - cosine to the nearest reference, both centred on `mean`: float32 (n,), 0 to 2."""

    def unit(x: np.ndarray) -> np.ndarray:
        x = x.astype(np.float32) - mean
        unit: np.ndarray = x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
        return unit

    found: np.ndarray = 1 - (unit(features) @ unit(references).T).max(1)
    return found


def calibrate(head: ScaleHead, validation: Examples) -> dict[str, Any]:
    """What head.json says of the head's limits, measured on the validation images.

    far : distance from the training captions (see `distance`) that 1% of the validation captions
        exceed: a caption beyond it is unlike what the head has learned from.
    prior : how far scale and shift are off from the images' own fits: standard deviations of the
        relative errors (by the median absolute deviation, so that single bad fits do not count)
        and their correlation. See `correction.refine`.
    """
    features = validation.rows(np.arange(len(validation)))
    said: dict[str, Any] = {}
    # A head of objects keeps their names instead, see `novel`.
    if head.reference is not None and "object_dim" not in head.about.sizes:
        far = np.quantile(distance(features, head.reference, head.mean.numpy()), 0.99)
        said["far"] = round(float(far), 4)
    # A head that has collapsed may say 0 or inf, as exp does of a large number.
    predicted = np.clip(np.stack(head.outputs(features), 1), 1e-12, 1e12)  # (n, 2)
    error = (validation.fit - predicted) / predicted
    error = error[np.isfinite(error).all(1)]
    if len(error) >= 10:
        spread = 1.4826 * np.median(np.abs(error), axis=0)
        clipped = np.clip(error, -3 * spread, 3 * spread)
        together = np.corrcoef(clipped.T)[0, 1] if (clipped.std(0) > 1e-9).all() else 0.0
        said["prior"] = Prior(
            scale=round(max(float(spread[0]), 0.01), 4),
            shift=round(max(float(spread[1]), 0.01), 4),
            correlation=round(float(np.clip(together, -0.99, 0.99)), 4),
        )
    return said
