"""Heads by what a user calls them: a path, a name in the work dir, a ready name, an address."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from ...common.errors import RsaDataError, UsageError, unknown
from ...store.tables import WorkDir
from .. import ready, travel

if TYPE_CHECKING:
    from ..checkpoint import ScaleHead

# What train-head calls a head that was given no name.
DEFAULT = "head"


def find(work: WorkDir, name: str | None) -> "ScaleHead":
    """The head of that name: a path, one of the work dir, a ready head or an address.

    name : None for the work dir's head of the default name, or its only one.
    Raises UsageError with the nearest name when there is no such head.
    """
    from ..checkpoint import ScaleHead

    there = in_work(work)
    if name is None:
        if DEFAULT not in there and len(there) != 1:
            raise _choose(work, there)
        name = DEFAULT if DEFAULT in there else there[0]
        return ScaleHead.load(f"{work.store.location}/heads/{name}")
    if "://" in name:
        return travel.from_address(name)
    path = Path(name)
    if sum((is_path(name), name in there, name in ready.names())) > 1:
        where = f"the path {name}" if is_path(name) else work.store.location
        warnings.warn(
            f"--head {name}: there are several of this name; {where} is taken", stacklevel=2
        )
    if path.is_file():
        return travel.from_file(path)
    if (path / "head.json").is_file():
        return ScaleHead.load(path)
    if name in there:
        return ScaleHead.load(f"{work.store.location}/heads/{name}")
    if name in ready.names():
        return ready.load(name)
    if path.suffix or "/" in name:
        raise RsaDataError(f"--head {name}: expected a head; there is no such file or folder")
    where = f"head in {work.store.location} or among ready heads"
    raise UsageError(f"{unknown(where, name, _all(there))}{_below(work)}")


def is_path(name: str) -> bool:
    """Whether a head of that name is a file or folder."""
    return Path(name).is_file() or (Path(name) / "head.json").is_file()


def in_work(work: WorkDir) -> list[str]:
    """Names of the finished heads of a work dir."""
    found = [entry.rstrip("/") for entry in work.store.list("heads") if entry.endswith("/")]
    return [n for n in found if work.store.size(f"heads/{n}/head.json") is not None]


def _all(there: list[str]) -> list[str]:
    return [*there, *ready.names()]


def _choose(work: WorkDir, there: list[str]) -> UsageError:
    found = f"several: {', '.join(there)}" if there else "none"
    return UsageError(
        f"--head: expected the name of a head; {work.store.location} holds {found}."
        f"{_below(work)} Ready heads: {', '.join(ready.names())}. With known distances no head is "
        "needed: --known u,v,metres"
    )


def _below(work: WorkDir) -> str:
    """The heads of work dirs that lie in this one, as that of the demo does, in a sentence."""
    said = ""
    for entry in work.store.list("") if "://" not in work.store.location else []:
        inner = WorkDir(f"{work.store.location.rstrip('/')}/{entry.rstrip('/')}")
        if entry.endswith("/") and (found := in_work(inner)):
            said += f" --work {inner.store.location} holds {', '.join(found)}."
    return said
