"""From files on disk to a samples table: walking folders, split files, checks that all share."""

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any

import pyarrow as pa

from ..common import bounded, text_files
from ..common.errors import RsaDataError
from ..common.forms import is_path
from ..store import schemas
from .images import readable

_DEEPEST = 40
_AT_A_TIME = 4096


@dataclass(frozen=True, slots=True)
class Sample:
    """One row of samples before the dataset's name is put before its key.

    image, depth : paths relative to the dataset's root, forward slashes.
    camera : fx, fy, cx, cy in px, each None where unknown.
    size : width, height in px where the dataset's own listing tells them.
    """

    split: str
    key: str
    scene: str
    image: str | None
    depth: str | None
    camera: tuple[float | None, float | None, float | None, float | None] = (None,) * 4
    size: tuple[int | None, int | None] = (None, None)


def to_table(
    name: str,
    root: Path,
    samples: Iterable[Sample],
    split: str | None,
    *,
    in_order: bool = False,
) -> pa.Table:
    """The samples table of dataset `name`, sorted by split and sample_id.

    split : keep this split only; None for all. in_order : samples of a split stay in the order in
        which they come, which is that of their shards; their keys are not compared.

    Raises RsaDataError when nothing is left, when two samples have the same key, or when a file
    name is not UTF-8.
    """
    rows = [s for s in samples if split in (None, s.split)]
    rows.sort(key=(lambda s: s.split) if in_order else (lambda s: (s.split, s.key)))
    if not rows:
        raise nothing_found(name, root, split)
    if not in_order:  # those of shards are compared by FoundSamples, as those of all shards are
        for a, b in pairwise(rows):
            if (a.split, a.key) == (b.split, b.key):
                raise RsaDataError(
                    f"{name}: expected one image for each key, found {a.image} and {b.image} with "
                    f"the same key {a.split}/{a.key}; remove or rename one of them"
                )
    try:
        # Piece by piece: as lists of Python's objects, the columns of all would be the most memory.
        starts = range(0, len(rows), _AT_A_TIME)
        return pa.concat_tables(_columns(name, rows[s : s + _AT_A_TIME]) for s in starts)
    except UnicodeEncodeError as error:
        raise RsaDataError(
            f"{name}: {root}: expected file names in UTF-8, found {error.object!r}; rename it"
        ) from error


def _columns(name: str, rows: list[Sample]) -> pa.Table:
    cameras = [list(column) for column in zip(*(s.camera for s in rows), strict=True)]
    return schemas.from_columns(
        "samples",
        {
            "sample_id": [f"{name}/{s.split}/{s.key}" for s in rows],
            "dataset": [name] * len(rows),
            "split": [s.split for s in rows],
            "scene": [s.scene for s in rows],
            "image": [s.image for s in rows],
            "depth": [s.depth for s in rows],
            # Reading 48,000 headers would make of seconds minutes; the stages that decode know.
            "width": [s.size[0] for s in rows],
            "height": [s.size[1] for s in rows],
            "fx": cameras[0],
            "fy": cameras[1],
            "cx": cameras[2],
            "cy": cameras[3],
        },
    )


def nothing_found(name: str, root: Path, split: str | None) -> RsaDataError:
    """The error for a root without an image of the split, or of any for None."""
    what = f"split {split!r}" if split else "any split"
    return RsaDataError(f"{name}: {root}: expected images of {what}, found none; {guide(name)}")


def guide(name: str) -> str:
    """The way out of every error about a layout."""
    return f"see `rsa-data list datasets {name}`"


def require_folder(name: str, root: Path, *wanted: str) -> None:
    """Raises RsaDataError unless `root` is a folder with at least one of `wanted` in it."""
    if not root.is_dir():
        found = "a file" if root.exists() else "nothing there"
        raise RsaDataError(f"{name}: expected its folder at {root}, found {found}; {guide(name)}")
    if wanted and not any((root / w).exists() for w in wanted):
        found = ", ".join(sorted(p.name for p in root.iterdir())[:8]) or "an empty folder"
        raise RsaDataError(
            f"{name}: {root}: expected {' or '.join(wanted)} in it, found {found}; {guide(name)}"
        )


def files_below(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """(folder relative to `folder` with a slash at the end or "", file names), names sorted.

    Hidden files and folders are left out. Links to folders are followed, each folder once.
    """
    seen: set[tuple[int, int]] = set()
    waiting = [""]
    while waiting:
        below = waiting.pop()
        if isinstance(folder, Path):
            status = (folder / below).stat()
            if (status.st_dev, status.st_ino) in seen:
                continue
            seen.add((status.st_dev, status.st_ino))
        files, folders = entries(folder / below)
        _check_depth(folder, below)
        yield below, files
        waiting += [f"{below}{name}/" for name in reversed(folders)]


def folders_with(folder: Path, *wanted: str) -> Iterator[str]:
    """Folders below `folder`, relative to it, that hold all of the folders `wanted`; sorted.

    Nothing is looked for below them. Hidden folders are left out.
    """
    waiting = [""]
    while waiting:
        below = waiting.pop()
        names = entries(folder / below)[1]
        _check_depth(folder, below)
        if set(names).issuperset(wanted):
            yield below.rstrip("/")
        else:
            waiting += [f"{below}{name}/" for name in reversed(names)]


def _check_depth(folder: Path, below: str) -> None:
    """A server, or links that lead round, can show a folder in every folder."""
    if below.count("/") > _DEEPEST:
        raise RsaDataError(
            f"{folder}: expected folders in at most {_DEEPEST} folders, found {below[:80]}..."
        )


def entries(folder: Path) -> tuple[list[str], list[str]]:
    """Names of the files and of the folders in a folder, sorted, without hidden ones."""
    found: tuple[list[str], list[str]] = [], []
    try:
        # Path.iterdir would ask the file system once more for each entry.
        there = os.scandir(folder) if isinstance(folder, Path) else folder.iterdir()
        for entry in there:
            if not entry.name.startswith("."):
                found[_is_folder(entry)].append(entry.name)
    except OSError as error:
        raise RsaDataError(f"{folder}: cannot be listed: {error.strerror}") from error
    return sorted(found[0]), sorted(found[1])


def _is_folder(entry: Any) -> bool:
    try:
        return bool(entry.is_dir())
    except OSError:
        if isinstance(entry, os.DirEntry):
            return False  # a link to itself: reading it fails as a file, a row of its own
        raise


def is_image(name: str) -> bool:
    """Whether a file's name ends like an image's."""
    return PurePosixPath(name).suffix.lower() in readable()


def stem(path: str) -> str:
    """The path without its last suffix, which is what keys are made of."""
    return str(PurePosixPath(path).with_suffix(""))


def lines(path: Path, name: str) -> Iterator[tuple[str, list[str]]]:
    """(where, fields) of each line of a text file that is not blank; see `whole_lines`."""
    for where, line in whole_lines(path, name):
        yield where, line.split()


def whole_lines(path: Path, name: str) -> Iterator[tuple[str, str]]:
    """(where, line) of each line of a text file that is not blank; where is "file line N".

    Spaces and tabs at both ends are left out. Raises RsaDataError when the file is missing, too
    large or not UTF-8 text.
    """
    try:
        text = bounded.read_text(path)
    except OSError as error:
        raise RsaDataError(
            f"{name}: {path}: expected a text file, found: {error.strerror}; {guide(name)}"
        ) from error
    for number, line in enumerate(text_files.lines(text), 1):
        if line.strip():
            yield f"{name}: {path} line {number}", line.strip(" \t")


def paths(listed: Path, name: str) -> Iterator[tuple[str, str]]:
    """(where, path below the root) of each line of a list of paths; see `lines` and `inside`."""
    for where, line in whole_lines(listed, name):
        yield where, str(PurePosixPath(inside(line, where)))


def inside(text: str, where: str) -> str:
    """A path of a split file, relative to root, refused when it would lead out of it.

    BTS begins paths with a slash and means the root of the data, so one is taken away.
    """
    path = PurePosixPath(text.removeprefix("/"))
    if path.is_absolute() or ".." in path.parts or not is_path(str(path)):
        raise RsaDataError(
            f"{where}: expected a path below the dataset's root, found {text!r}; correct that line"
        )
    return str(path)
