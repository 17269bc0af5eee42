"""Which pixels are drawn, and how relative depth fits the truth."""

import hashlib

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from rsa_data.depth import fits, pixels


@given(st.integers(1, 300), st.integers(1, 300), st.integers(0, 9), st.text(max_size=9))
def test_draw_takes_each_number_once_before_any_twice(n, k, seed, sample_id):
    drawn = pixels.draw(n, k, seed, sample_id)
    counts = np.bincount(drawn, minlength=n)
    assert len(drawn) == k
    assert counts.max() - counts.min() <= 1
    assert np.array_equal(drawn, pixels.draw(n, k, seed, sample_id))
    if k <= n:  # the first few are what a smaller draw gives
        assert np.array_equal(drawn[: k // 2 + 1], pixels.draw(n, k // 2 + 1, seed, sample_id))


@pytest.mark.parametrize(("n", "k"), [(1, 1), (7, 7), (9, 4), (3, 8)])
def test_draw_sorts_by_splitmix64(n, k):
    # The published generator number by number (Vigna, splitmix64.c), seeded with the key's hash.
    state = int.from_bytes(hashlib.blake2b(b"5\0a/b", digest_size=8).digest(), "little")
    keys, mask = [], 2**64 - 1
    for _ in range(n):
        state = (state + 0x9E3779B97F4A7C15) & mask
        z = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & mask
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
        keys.append(z ^ (z >> 31))
    order = sorted(range(n), key=keys.__getitem__)
    assert pixels.draw(n, k, 5, "a/b").tolist() == (order * k)[:k]


def test_draw_is_uniform():
    counts = sum(np.bincount(pixels.draw(50, 10, 0, str(i)), minlength=50) for i in range(2000))
    assert scipy.stats.chisquare(counts).pvalue > 1e-3


@given(st.integers(0, 2**32))
def test_inverse_fit_equals_scipy(seed):
    rng = np.random.default_rng(seed)
    y, depth = rng.normal(5, 2, 60), rng.uniform(0.5, 80, 60)
    slope, intercept, *_ = scipy.stats.linregress(y, 1 / depth)
    assert fits.inverse_fit(y, depth) == pytest.approx((slope, intercept), rel=1e-9, abs=1e-12)


def test_two_points_are_fitted_exactly_and_one_is_not():
    # 1 / 2 = 3 a + b and 1 / 4 = 1 a + b.
    fit = fits.inverse_fit(np.array([3.0, 1.0]), np.array([2.0, 4.0]))
    assert fit == pytest.approx((0.125, 0.125), rel=1e-12)
    assert fits.inverse_fit(np.array([3.0]), np.array([2.0])) is None
    assert fits.median_scale(np.array([3.0]), np.array([2.0])) == pytest.approx(6.0)


def test_fits_that_are_left_open():
    assert fits.inverse_fit(np.ones(5), np.arange(1, 6)) is None
    assert fits.median_scale(np.array([-1.0, 0.0]), np.ones(2)) is None
    assert fits.median_scale(np.array([-1.0, 2.0, 4.0]), np.array([9, 1.0, 3.0])) == 2 / 0.375
