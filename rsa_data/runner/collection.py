"""What a work dir holds beside datasets, such as heads, as status and verify see it."""

from collections.abc import Callable
from dataclasses import dataclass

from ..store.tables import WorkDir


@dataclass(frozen=True)
class Collection:
    """One folder of a work dir beside its datasets; see `registry.COLLECTIONS`.

    names : the finished entries.
    state : (work dir, entry) -> what is out of date or damaged, in a sentence; "" for nothing.
    """

    names: Callable[[WorkDir], list[str]]
    state: Callable[[WorkDir, str], str]
