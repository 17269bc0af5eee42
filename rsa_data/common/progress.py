"""What a running command says: rows that a step has done, and lines that a person must see now."""

import sys
from collections.abc import Callable

from .terminal import plain

_listeners: list[Callable[[int], None]] = []


def advance(rows: int) -> None:
    """Tells the listener of this process, if any, that `rows` more input rows are done."""
    for listener in _listeners:
        listener(rows)


def listen(listener: Callable[[int], None] | None) -> None:
    """Makes `listener` the one that `advance` calls in this process; None for nobody."""
    _listeners[:] = [listener] if listener else []


class Proportion:
    """Advances by rows in proportion to another measure of the work, such as tokens.

    rows : in all; work : in all, in the other measure.
    """

    def __init__(self, rows: int, work: int):
        self.rows, self.work, self.done, self.advanced = rows, max(1, work), 0, 0

    def add(self, work: int) -> None:
        """So much more work is done."""
        self.done += work
        now = self.rows * self.done // self.work
        advance(now - self.advanced)
        self.advanced = now


def notice(line: str) -> None:
    """Shows a line at once, on standard error: what is only logged goes to the log of the run."""
    sys.stderr.write(plain(line) + "\n")
    sys.stderr.flush()
