"""Reading ahead: what the next rows need is read while earlier ones are worked on."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

from . import progress
from .errors import RowError

T = TypeVar("T")
R = TypeVar("R")


def ahead(
    pool: ThreadPoolExecutor, read: Callable[[T], R], items: Iterable[T], most: int
) -> Iterator[R | RowError]:
    """`read` of each item, or the RowError it ended in, in the order of `items`.

    most : items begun before they are asked for; what they give is held in memory.
    """
    futures: deque[Future[R]] = deque()
    try:
        for item in items:
            futures.append(pool.submit(read, item))
            if len(futures) > most:
                yield settled(futures.popleft())
        while futures:
            yield settled(futures.popleft())
    finally:
        for future in futures:  # after an error nobody wants them
            future.cancel()


def each(one: Callable[[T], R], items: Iterable[T], helpers: int) -> Iterator[R | RowError]:
    """`one` of each item in order, by `helpers` threads; each is one row of progress."""
    with ThreadPoolExecutor(helpers) as pool:
        for found in ahead(pool, one, items, helpers):
            progress.advance(1)
            yield found


def settled(future: Future[Any]) -> Any:
    """A future's result, or the RowError that it ended in."""
    try:
        return future.result()
    except RowError as error:
        return error
