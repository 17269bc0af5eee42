"""The counter-based random bits."""

import numpy as np

from rsa_data.captions.chance import caption_keys, mix, object_bits


def splitmix64(seed: int, count: int) -> list[int]:
    """The published generator, number by number: Vigna's splitmix64.c."""
    mask, found = 2**64 - 1, []
    for _ in range(count):
        seed = (seed + 0x9E3779B97F4A7C15) & mask
        z = seed
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
        found.append(z ^ (z >> 31))
    return found


def test_object_bits_are_splitmix64():
    keys = np.array([[1234567, 2**64 - 1]], np.uint64)
    made = [object_bits(keys, index)[0].tolist() for index in range(4)]
    assert list(zip(*made, strict=True)) == [
        tuple(splitmix64(1234567, 4)),
        tuple(splitmix64(2**64 - 1, 4)),
    ]
    # As published for this seed, in Rosetta Code among others.
    assert made[0][0] == 6457827717110365317


def test_mix_may_work_in_place():
    state = np.arange(10, dtype=np.uint64)
    expected = mix(state)
    assert mix(state, state) is state
    assert state.tolist() == expected.tolist()


def test_keys_depend_on_seed_sample_and_variant_alone():
    keys = caption_keys(7, ["a", "b", "c"], 4)
    assert keys.shape == (4, 3)
    assert caption_keys(7, ["c"], 2).tolist() == keys[:2, 2:].tolist()
    assert len(set(keys.ravel().tolist())) == 12
    assert not set(caption_keys(8, ["a", "b", "c"], 4).ravel().tolist()) & set(
        keys.ravel().tolist()
    )
    assert caption_keys(7 + 2**64, ["a"], 1).tolist() == keys[:1, :1].tolist()


def test_bits_are_even():
    keys = caption_keys(0, map(str, range(1000)), 10)
    bits = np.stack([object_bits(keys, index) for index in range(10)])
    ones = np.unpackbits(bits.view(np.uint8)).reshape(-1, 64).mean(0)
    # 100,000 draws of each bit: 5 standard deviations are 0.008.
    assert abs(ones - 0.5).max() < 0.008
