"""What a work dir holds beside datasets, such as heads, as status and verify see it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ..store.tables import WorkDir


@dataclass(frozen=True)
class Collection:
    """One folder of a work dir beside its datasets; see `registry.COLLECTIONS`.

    names : the finished entries.
    check : (work dir, entry) -> problems of what lies there, a sentence each; reads it all.
    state : (work dir, entry) -> what is out of date or damaged, in a sentence; "" for nothing.
    """

    names: Callable[[WorkDir], list[str]]
    check: Callable[[WorkDir, str], Iterator[str]]
    state: Callable[[WorkDir, str], str]
