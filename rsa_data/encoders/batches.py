"""Batches by length: little padding, and the same batches for the same texts whoever computes."""

from collections.abc import Iterator, Sequence

import numpy as np


def by_length(lengths: np.ndarray, budget: int) -> Iterator[np.ndarray]:
    """Row numbers of each batch: rows sorted by length (ties by row), longest batch first.

    lengths : int of shape (n,), tokens of each text.
    budget : tokens of a batch, padding included; a text longer than it gets a batch of its own.

    Longest first, so that what a batch needs of memory is known from the first one.
    """
    order = np.argsort(-lengths, kind="stable")
    start = 0
    while start < len(order):
        longest = int(lengths[order[start]])
        stop = start + max(1, budget // max(1, longest))
        yield order[start:stop]
        start = stop


def padded(ids: Sequence[Sequence[int]], pad: int) -> tuple[np.ndarray, np.ndarray]:
    """ids of several texts as one array int64 of shape (b, t) filled up with `pad`, and lengths."""
    lengths = np.array([len(row) for row in ids], np.int64)
    batch = np.full((len(ids), int(lengths.max())), pad, np.int64)
    batch[np.arange(batch.shape[1]) < lengths[:, None]] = np.concatenate(ids)
    return batch, lengths
