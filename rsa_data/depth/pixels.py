"""Which pixels of an image are drawn: a counter-based mix, so every image stands for itself."""

import hashlib

import numpy as np


def mix(values: np.ndarray) -> np.ndarray:
    """SplitMix64's finaliser (Steele et al. 2014): uint64 -> uint64 that look independent."""
    with np.errstate(over="ignore"):
        values = (values ^ (values >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        values = (values ^ (values >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed: np.ndarray = values ^ (values >> np.uint64(31))
    return mixed


def draw(n: int, k: int, seed: int, sample_id: str) -> np.ndarray:
    """`k` of the numbers 0 to n - 1 in random order, each once while they last (n at least 1).

    Depends on nothing but the arguments, so that neither the part, the worker nor the order of
    the images matters. With n below k the whole order is repeated until k stand there. Any first
    few are a random sample too. Returns int64 of shape (k,).
    """
    key = hashlib.blake2b(f"{seed}\0{sample_id}".encode(), digest_size=8).digest()
    counter = np.arange(1, n + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    keys = mix(counter + np.uint64(int.from_bytes(key, "little")))
    nearest = np.arange(n)
    if k < n:
        # All that tie with the k-th key stay, so that the partition's order does not matter.
        nearest = np.flatnonzero(keys <= np.partition(keys, k - 1)[k - 1])
    order = nearest[np.argsort(keys[nearest], kind="stable")]
    return np.resize(order, k)
