"""Pairing colour with depth frames by the times in their names, where cameras are not in step."""

from bisect import bisect_left
from collections.abc import Sequence


def nearest(
    times: Sequence[float], frames: Sequence[tuple[float, str]], within: float
) -> list[str | None]:
    """For each time the frame nearest to it, or None where none is `within` of it.

    frames : (time, name), sorted; of two equally near the earlier is taken.
    """
    known = [time for time, _ in frames]
    found: list[str | None] = []
    for time in times:
        right = bisect_left(known, time)
        near = min(
            frames[max(0, right - 1) : right + 1], key=lambda f: abs(f[0] - time), default=None
        )
        found.append(near[1] if near and abs(near[0] - time) <= within else None)
    return found
