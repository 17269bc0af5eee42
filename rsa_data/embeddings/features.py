"""Features as tables hold them: each once, finite, not all zero, in the dtype asked for."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from ..common.errors import RsaDataError


def gathered(
    found: Iterable[tuple[np.ndarray, np.ndarray]],
    wanted: np.ndarray,
    dim: int,
    done: Callable[[np.ndarray], object] | None = None,
) -> np.ndarray:
    """Features of batches in one array, float32 (n, dim), 0 where none is wanted.

    found : row numbers (b,) and features (b, dim) of each batch. wanted : bool (n,), the rows that
    they must hold, each once. done : is told the rows of each batch.

    Raises RsaDataError for an encoder that gives something else.
    """
    features = np.zeros((len(wanted), dim), np.float32)
    times = np.zeros(len(wanted), np.int64)
    for rows, values in found:
        if values.shape != (len(rows), dim) or values.dtype.kind != "f":
            raise RsaDataError(
                f"the encoder: expected real numbers of shape ({len(rows)}, {dim}) for a batch of "
                f"{len(rows)}; found {values.dtype} of shape {values.shape}"
            )
        if len(rows) and not 0 <= rows.min() <= rows.max() < len(wanted):
            raise RsaDataError(
                f"the encoder's batches: expected row numbers of 0 to {len(wanted) - 1}; found "
                f"{rows.min()} to {rows.max()}"
            )
        features[rows] = values
        np.add.at(times, rows, 1)
        if done is not None:
            done(rows)
    if len(wrong := np.flatnonzero(times != wanted)):
        raise RsaDataError(
            f"the encoder's batches: expected each row once; found row {wrong[0]} "
            f"{times[wrong[0]]} times"
        )
    return features


# The smallest number that float16 holds with all its digits.
_NORMAL = float(np.finfo(np.float16).tiny)


def stored(features: np.ndarray, store: str) -> np.ndarray:
    """float32 features (n, dim) in the dtype `store`.

    Raises RsaDataError for a feature too large for it, or of which hardly a digit would be left.
    """
    if store == "float16":
        largest = np.abs(features).max(1, initial=0)
        small = largest[(largest > 0) & (largest < _NORMAL)]
        if len(small):
            raise RsaDataError(
                f"embed: a feature holds no number above {small.min():.3g}, of which float16 keeps "
                "hardly a digit: use --store float32"
            )
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
