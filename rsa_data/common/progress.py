"""Progress inside a part: a step says how many rows it has done, whoever listens shows it."""

from collections.abc import Callable

_listeners: list[Callable[[int], None]] = []


def advance(rows: int) -> None:
    """Tells the listener of this process, if any, that `rows` more input rows are done."""
    for listener in _listeners:
        listener(rows)


def listen(listener: Callable[[int], None] | None) -> None:
    """Makes `listener` the one that `advance` calls in this process; None for nobody."""
    _listeners[:] = [listener] if listener else []
