"""What a command writes where the user says so never takes the place of what it reads."""

from collections.abc import Iterable
from pathlib import Path

from .errors import UsageError

# Files whose folder is a table, a head or an evaluation of a work dir; see store and evaluation.
_OWNED = ("_table.json", "_evaluation.json")


def check_output(path: Path, reads: Iterable[Path] = (), kinds: Iterable[str] = ()) -> None:
    """Raises UsageError where writing to `path` would spoil what was read or a work dir holds.

    That is: one of the files `reads`; in one of the folders `reads`, a file that is there and has
    an ending of `kinds`; and anything in the folder of a table, a head or an evaluation.
    """
    for read in reads:
        inside = read.is_dir() and read.resolve() in path.resolve().parents
        if path.exists() and (path.samefile(read) or (inside and path.suffix.lower() in kinds)):
            raise UsageError(f"{path}: expected a file that is not read in the same call")
    for folder in (path, *path.absolute().parents):
        if owner := next((name for name in _OWNED if (folder / name).is_file()), None):
            raise UsageError(
                f"{path}: expected a place outside of the tables and heads of a work dir; found "
                f"{owner} in {folder}"
            )
