"""Randomness without state: numbers that depend on (seed, sample_id, variant, object) alone.

A counter-based mix over whole columns. The bits of a caption are the same in any part, block or
process, whatever other rows stand beside it.
"""

import hashlib
from collections.abc import Iterable

import numpy as np

# splitmix64: the increment (2**64 over the golden ratio) and its finaliser's shifts and
# multipliers; Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014.
_STEP = 0x9E3779B97F4A7C15
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)


def mix(state: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """splitmix64's finaliser: uint64 array -> uint64 array of the same shape, well mixed.

    out : where the result goes; may be `state` itself.
    """
    shifted = state >> np.uint64(30)
    out = np.bitwise_xor(state, shifted, out=out)
    out *= _FIRST
    np.right_shift(out, np.uint64(27), out=shifted)
    out ^= shifted
    out *= _SECOND
    np.right_shift(out, np.uint64(31), out=shifted)
    out ^= shifted
    return out


def caption_keys(seed: int, sample_ids: Iterable[str], variants: int) -> np.ndarray:
    """A key for each variant of each sample: uint64 array of shape (variants, samples).

    seed : any integer; numbers that are equal modulo 2**64 are one seed.
    """
    # BLAKE2b once a sample, not once a caption: ids that differ in one letter share no bits.
    digests = [hashlib.blake2b(name.encode(), digest_size=8).digest() for name in sample_ids]
    salt = mix(np.array([(seed + _STEP) % 2**64], np.uint64))
    samples = mix(np.frombuffer(b"".join(digests), "<u8") ^ salt)  # (samples,)
    counter = np.arange(variants, dtype=np.uint64) * np.uint64(_STEP)
    return mix(samples + counter[:, None])  # (variants, samples)


def object_bits(keys: np.ndarray, index: int, out: np.ndarray | None = None) -> np.ndarray:
    """64 random bits for object `index` of every caption; keys as `caption_keys` gives them."""
    bits = np.add(keys, np.uint64(_STEP * (index + 1) % 2**64), out=out)
    return mix(bits, bits)
