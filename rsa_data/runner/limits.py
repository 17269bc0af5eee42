"""What ends a run early: more failures than the user allows, less space than it will need."""

from collections.abc import Callable, Iterable

from ..common.errors import RsaDataError, UsageError
from ..common.numbers import real, whole
from ..common.units import size
from .jobs import Job

# Before so many rows a share says little about the rest of a run; at its end it is judged anyway.
_ENOUGH_ROWS = 50


def parse_failures(text: str) -> float | int:
    """`5%` or `0.05` as a share (float), `100` as a count (int); raises UsageError."""
    try:
        value = real(text[:-1]) / 100 if text.endswith("%") else real(text)
        count = "%" not in text and "." not in text
        if (value >= 0) if count else (0 <= value <= 1):
            return whole(text) if count else value
    except ValueError:
        pass
    raise UsageError(
        f"--max-failures: expected a count such as 100 or a share such as 5%; found {text!r}"
    )


def check_failures(
    failed: int,
    seen: int,
    most: float | int | None,
    reasons: Callable[[], list[tuple[str, int]]],
    *,
    ended: bool = False,
) -> None:
    """Raises RsaDataError when more of the `seen` rows failed than the user allows.

    ended : these are all rows there are, not the first ones. Then it is also an error if every row
    failed, whatever the user allows.
    """
    if not failed:
        return
    if ended and failed == seen:
        raise RsaDataError(f"all {failed:,} rows failed. {_told(reasons())}. {_FIX}")
    if most is None:
        return
    if isinstance(most, int):
        too_many, limit = failed > most, f"{most:,}"
    else:
        too_many = (ended or seen >= _ENOUGH_ROWS) and failed > most * seen
        limit = f"{most:.3g} of the rows"
    if too_many:
        raise RsaDataError(
            f"stopped: {failed:,} of {seen:,} rows failed, more than --max-failures {limit}. "
            f"{_told(reasons())}. Finished parts are kept. {_FIX}, then the same command again; "
            "or allow more failures"
        )


_FIX = "Fix the input and run `rsa-data retry-failed`"


def _told(reasons: list[tuple[str, int]]) -> str:
    return "; ".join(f"{count:,} times, such as: {reason}" for reason, count in reasons)


def check_space(job: Job, done: list[int], left: Iterable[int]) -> None:
    """Raises RsaDataError when the parts `left` will not fit, going by those that are done.

    Bytes of a sample are taken split by split: test splits hold whole depth maps.
    """
    table, samples = job.table(job.output), job.table("samples")
    free = table.store.free()
    if free is None or not done:
        return
    used: dict[str, list[int]] = {}
    for receipt, sample in zip(table.receipts(done), samples.receipts(done), strict=True):
        sums = used.setdefault(receipt.split, [0, 0])
        sums[0] += receipt.bytes
        sums[1] += sample.rows
    need = 0.0
    for receipt in samples.receipts(left):
        if receipt.split in used:
            count, rows = used[receipt.split]
            need += count / rows * receipt.rows if rows else 0
    if need > free:
        raise RsaDataError(
            f"{table}: the parts that are left need about {size(need)}, {size(free)} are free. "
            "Finished parts are kept. Free some space, or do some parts only (--part-range A:B), "
            "then run the same command again"
        )
