"""What a running command says: rows that a step has done, and lines that a person must see now."""

import sys
from collections.abc import Callable

_listeners: list[Callable[[int], None]] = []


def advance(rows: int) -> None:
    """Tells the listener of this process, if any, that `rows` more input rows are done."""
    for listener in _listeners:
        listener(rows)


def listen(listener: Callable[[int], None] | None) -> None:
    """Makes `listener` the one that `advance` calls in this process; None for nobody."""
    _listeners[:] = [listener] if listener else []


def notice(line: str) -> None:
    """Shows a line at once, on standard error: what is only logged goes to the log of the run."""
    sys.stderr.write(line + "\n")
    sys.stderr.flush()
