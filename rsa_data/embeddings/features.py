"""Features as tables hold them: finite, not all zero, in the dtype that was asked for."""

from collections.abc import Sequence

import numpy as np

from ..common.errors import RsaDataError


def stored(features: np.ndarray, store: str) -> np.ndarray:
    """float32 features (n, dim) in the dtype `store`; raises RsaDataError on overflow."""
    with np.errstate(over="ignore"):
        stored = features.astype(store)
    if not np.isfinite(stored).all():
        raise RsaDataError(
            f"embed: a feature holds {np.abs(features).max():.3g}, which {store} cannot: use "
            "--store float32"
        )
    return stored


def check_finite(features: np.ndarray, texts: Sequence[str]) -> None:
    """Raises RsaDataError, naming the text, where a row (dim,) is not finite or all zero."""
    good = np.isfinite(features).all(1) & features.any(1)
    if not good.all():
        text = texts[int(np.flatnonzero(~good)[0])]
        raise RsaDataError(
            f"embed: expected a finite feature that is not all zero for {text[:60]!r}; found none. "
            "Are the weights damaged?"
        )
