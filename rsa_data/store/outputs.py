"""Files that a user names to be written: none of them may lie over what must stay."""

import os
import stat
from collections.abc import Collection, Iterable
from pathlib import Path

from ..common.errors import UsageError
from .receipts import TABLE
from .table_names import KEPT

Identity = tuple[int, int]

# Files whose folder is a table, a head or an evaluation.
_OWNED = ("_" + TABLE, "_evaluation.json")


def identities(places: Iterable[Path | str]) -> frozenset[Identity]:
    """Which files lie at these places, whatever else they are called; of a folder all files in it.

    Places where nothing is are left out.
    """
    found = set()
    for place in places:
        files = [Path(top, n) for top, _, names in os.walk(place) for n in names]
        found |= {one for file in (Path(place), *files) if (one := _identity(file))}
    return frozenset(found)


def check_output(
    path: Path,
    option: str = "",
    inputs: Collection[Identity] = (),
    *,
    folder: bool = False,
) -> None:
    """Raises UsageError unless a file, or folder, can be written there without loss.

    option : what the user gave the path by, which begins the message. inputs : see `identities`.

    Refused: an input of the command; what a work dir keeps, be it the one at hand or another;
    devices, pipes and sockets; a folder in place of a file, and the other way round.
    """
    told = f"{option} {path}: ".lstrip()
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        mode = None
    if _identity(path) in inputs:
        raise UsageError(
            f"{told}expected a file that is not read in the same call. Choose another name"
        )
    if (owner := _owner(Path(os.path.realpath(path)))) is not None:
        raise UsageError(
            f"{told}expected a place outside of the tables and heads of a work dir; found {owner}. "
            "Choose another name"
        )
    if mode is not None and not stat.S_ISDIR(mode) and not stat.S_ISREG(mode):
        raise UsageError(f"{told}expected the name of a file; found a pipe, socket or device")
    if mode is not None and stat.S_ISDIR(mode) != folder:
        kinds = ("a folder", "a file") if folder else ("a file", "a folder")
        raise UsageError(f"{told}expected the name of {kinds[0]}; found {kinds[1]} there")


def _identity(place: Path | str) -> Identity | None:
    try:
        about = Path(place).stat()
    except (OSError, ValueError):
        return None
    return about.st_dev, about.st_ino


def _owner(path: Path) -> str | None:
    """Which folder of a work dir a path lies in, or is, in words; None for none."""
    for place in (path, *path.parents):
        if name := next((n for n in _OWNED if (place / n).is_file()), None):
            return f"{name} in {place}"
        if is_dataset(place):
            return f"the folder of a dataset, {place}"
        if place.name in KEPT and is_work_dir(place.parent):
            return f"{place}, which a work dir keeps"
    return None


def is_dataset(place: Path) -> bool:
    """Whether a folder is that of a dataset in a work dir."""
    return any((place / "samples" / name).is_file() for name in ("_" + TABLE, TABLE))


def is_work_dir(place: Path) -> bool:
    """Whether a folder holds datasets or heads of a work dir."""
    try:
        heads = [*place.glob("heads/*/head.json"), *place.glob(f"heads/*/_{TABLE}")]
        return bool(heads) or any(is_dataset(entry) for entry in place.iterdir())
    except OSError:
        return False
