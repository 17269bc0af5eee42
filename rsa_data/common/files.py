"""Files that appear whole or not at all, and the folder of what was downloaded or computed once."""

import contextlib
import fcntl
import os
import re
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from .failpoints import failpoint

_PACKAGE = Path(__file__).parents[1]

_TEMPORARY = re.compile(r"\.(.+)\.[0-9a-f]{8}\.tmp")


def cache_folder(kind: str) -> Path:
    """Where files of a kind are kept between runs: below XDG_CACHE_HOME, else ~/.cache."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "rsa-data" / kind


def shipped(folder: str) -> Path:
    """`schemas`, `pipelines` or `data`: inside the wheel, or beside the package in a checkout."""
    inside = _PACKAGE / folder
    return inside if inside.is_dir() else _PACKAGE.parent / folder


@contextmanager
def replacing(target: Path, *, durable: bool = False) -> Iterator[BinaryIO]:
    """A file beside `target`, open for writing, that takes its place once the block has ended well.

    Readers see the old file or the new one; of several writers the last one stays. Nothing is left
    when the block raises; what a kill leaves goes with the next write of the file.
    durable : also through a power cut, which takes as long as the disk does.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    sweep(target.parent, target.name)
    file, temporary = locked_file(target)
    try:
        with file:
            failpoint("write")
            yield file
            failpoint("flush")
            file.flush()
            if durable:
                os.fsync(file.fileno())
            failpoint("rename")
            temporary.replace(target)
            failpoint("renamed")
    finally:
        temporary.unlink(missing_ok=True)


def write(target: Path, data: bytes | memoryview) -> None:
    """Puts the whole file there, replacing what was there; see `replacing`."""
    with replacing(target) as file:
        file.write(data)


@contextmanager
def appearing(target: Path) -> Iterator[Path]:
    """A hidden folder beside `target` that gets its name once the block has ended well.

    Raises OSError when something else than an empty folder has that name by then. Nothing is left
    when the block raises; what a kill leaves goes with the next try.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    sweep(target.parent, target.name)
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}.tmp")
    temporary.mkdir()
    lock = os.open(temporary, os.O_RDONLY)
    try:
        _lock(lock)
        yield temporary
        failpoint("rename")
        temporary.rename(target)
        failpoint("renamed")
    finally:
        os.close(lock)
        shutil.rmtree(temporary, ignore_errors=True)


def locked_file(target: Path) -> tuple[BinaryIO, Path]:
    """A new hidden file beside `target`, open and locked for as long as its writer lives.

    The kernel drops the lock when the writer dies, however it dies. Names with host and process
    numbers cannot tell that: numbers are given again, and containers share host names.
    """
    while True:
        temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}.tmp")
        file = temporary.open("xb")
        with contextlib.suppress(OSError):  # a file system without locks: age decides, see below
            _lock(file.fileno())
        if os.fstat(file.fileno()).st_nlink:
            return file, temporary
        file.close()  # swept away between the two lines above


def sweep(folder: Path, name: str | None = None) -> None:
    """Deletes what killed writers have left in a folder: of one target, or of all."""
    with contextlib.suppress(OSError):  # tidying up must never be what ends a run
        # Each write looks through the whole folder, so no Path is made of each name.
        with os.scandir(folder) as entries:
            hidden = [entry.name for entry in entries if entry.name.startswith(".")]
        for entry in hidden:
            match = _TEMPORARY.fullmatch(entry)
            if match and name in (None, match[1]):
                _remove_if_stale(folder / entry)


def _lock(descriptor: int) -> None:
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _remove_if_stale(temporary: Path) -> None:
    try:
        descriptor = os.open(temporary, os.O_RDONLY | os.O_NONBLOCK)
    except FileNotFoundError:
        return
    try:
        _lock(descriptor)
    except BlockingIOError:
        return  # its writer is alive
    except OSError:
        if time.time() - os.fstat(descriptor).st_mtime < 24 * 3600:
            return
    finally:
        os.close(descriptor)
    if temporary.is_dir():
        shutil.rmtree(temporary, ignore_errors=True)
    else:
        temporary.unlink(missing_ok=True)
