"""SplitMix64: a counter-based mix, so that random numbers follow from their keys alone.

Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014.
"""

import numpy as np

# The increment: 2**64 over the golden ratio, made odd.
STEP = 0x9E3779B97F4A7C15
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)


def mix(state: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """The finaliser: uint64 array -> uint64 array of the same shape, well mixed.

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
