"""The split files of BTS, which RSA and many others use: lines of `image depth focal`."""

from collections.abc import Iterator
from pathlib import Path

from ..common.errors import RsaDataError
from .listing import guide, inside, lines

# Where such files are looked for below the root: their folder's name in BTS and in RSA, and root.
_FOLDERS = ("", "train_test_inputs", "data_splits")


def find(root: Path, name: str, given: Path | None) -> Path | None:
    """The split file: the one that the user named, else `name` below root, else None."""
    if given is not None:
        return given
    found = (root / folder / name for folder in _FOLDERS)
    return next((path for path in found if path.is_file()), None)


def read(path: Path, name: str) -> Iterator[tuple[str, str | None, float]]:
    """(image, depth or None, focal length in px) of each line, paths as inside() gives them.

    `None` in the place of the depth means that this image has none. Raises RsaDataError naming
    file and line when a line is anything else.
    """
    for where, fields in lines(path, name):
        if len(fields) != 3:
            raise RsaDataError(
                f"{where}: expected `image depth focal`, found {len(fields)} fields; {guide(name)}"
            )
        image, depth, focal = fields
        try:
            length = float(focal)
        except ValueError:
            length = 0.0
        if not 0 < length < float("inf"):
            raise RsaDataError(f"{where}: expected a focal length above 0 px, found {focal!r}")
        yield inside(image, where), None if depth == "None" else inside(depth, where), length
