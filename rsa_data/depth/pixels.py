"""Which pixels of an image are drawn: a counter-based mix, so every image stands for itself."""

import hashlib

import numpy as np

from ..common.splitmix import STEP, mix


def draw(n: int, k: int, seed: int, sample_id: str) -> np.ndarray:
    """`k` of the numbers 0 to n - 1 in random order, each once while they last (n at least 1).

    Depends on nothing but the arguments, so that neither the part, the worker nor the order of
    the images matters. With n below k the whole order is repeated until k stand there. Any first
    few are a random sample too. Returns int64 of shape (k,).
    """
    key = hashlib.blake2b(f"{seed}\0{sample_id}".encode(), digest_size=8).digest()
    counter = np.arange(1, n + 1, dtype=np.uint64) * np.uint64(STEP)
    keys = mix(counter + np.uint64(int.from_bytes(key, "little")))
    nearest = np.arange(n)
    if k < n:
        # All that tie with the k-th key stay, so that the partition's order does not matter.
        nearest = np.flatnonzero(keys <= np.partition(keys, k - 1)[k - 1])
    order = nearest[np.argsort(keys[nearest], kind="stable")]
    return np.resize(order, k)
