"""Randomness without state: numbers that depend on (seed, sample_id, variant, object) alone.

A counter-based mix over whole columns. The bits of a caption are the same in any part, block or
process, whatever other rows stand beside it.
"""

import hashlib
from collections.abc import Iterable

import numpy as np

from ..common.splitmix import STEP, mix


def caption_keys(seed: int, sample_ids: Iterable[str], variants: int) -> np.ndarray:
    """A key for each variant of each sample: uint64 array of shape (variants, samples).

    seed : any integer; numbers that are equal modulo 2**64 are one seed.
    """
    # BLAKE2b once a sample, not once a caption: ids that differ in one letter share no bits.
    digests = [hashlib.blake2b(name.encode(), digest_size=8).digest() for name in sample_ids]
    salt = mix(np.array([(seed + STEP) % 2**64], np.uint64))
    samples = mix(np.frombuffer(b"".join(digests), "<u8") ^ salt)  # (samples,)
    counter = np.arange(variants, dtype=np.uint64) * np.uint64(STEP)
    return mix(samples + counter[:, None])  # (variants, samples)


def object_bits(keys: np.ndarray, index: int, out: np.ndarray | None = None) -> np.ndarray:
    """64 random bits for object `index` of every caption; keys as `caption_keys` gives them."""
    bits = np.add(keys, np.uint64(STEP * (index + 1) % 2**64), out=out)
    return mix(bits, bits)
