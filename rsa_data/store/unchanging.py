"""A store that is asked each question once, for looks at a work dir that stays as it is."""

from typing import Any

from .stores import Store
from .tables import WorkDir


class Unchanging:
    """What a store answered first to `list`, `size` and `read`; everything else is the store's."""

    def __init__(self, store: Store):
        self._store = store
        self._known: dict[tuple[str, str], Any] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._store, name)

    def list(self, folder: str) -> list[str]:
        """Names in a folder, as they were."""
        found: list[str] = self._once("list", folder)
        return found

    def size(self, path: str) -> int | None:
        """Bytes of a file, as it was."""
        found: int | None = self._once("size", path)
        return found

    def read(self, path: str) -> bytes | None:
        """A file, as it was."""
        found: bytes | None = self._once("read", path)
        return found

    def _once(self, what: str, where: str) -> Any:
        if (what, where) not in self._known:
            self._known[what, where] = getattr(self._store, what)(where)
        return self._known[what, where]


def unchanging(work: WorkDir) -> WorkDir:
    """The same work dir, for a while in which nothing in it changes: on an object store each
    question is a request."""
    same = WorkDir.__new__(WorkDir)
    same.store = Unchanging(work.store)
    return same
