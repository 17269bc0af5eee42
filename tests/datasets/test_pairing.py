"""Pairing by time, against trying every frame."""

from hypothesis import given
from hypothesis import strategies as st

from rsa_data.datasets.pairing import nearest

TIMES = st.lists(st.integers(0, 40), max_size=8)


@given(TIMES, TIMES, st.integers(0, 10))
def test_nearest_is_the_nearest_of_all(times, known, within):
    frames = sorted((time, f"{i}") for i, time in enumerate(known))
    found = nearest(times, frames, within)
    for time, name in zip(times, found, strict=True):
        best = min((abs(t - time) for t in known), default=99)
        assert (name is not None) == (best <= within)
        assert name is None or abs(known[int(name)] - time) == best
