"""Files that appear whole or not at all, and the folder of what was downloaded or computed once."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

_PACKAGE = Path(__file__).parents[1]


def cache_folder(kind: str) -> Path:
    """Where files of a kind are kept between runs: below XDG_CACHE_HOME, else ~/.cache."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "rsa-data" / kind


@contextmanager
def replacing(target: Path, *, durable: bool = False) -> Iterator[BinaryIO]:
    """A file beside `target`, open for writing, that takes its place once the block has ended well.

    Readers see the old file or the new one; of several writers the last one stays. Nothing is left
    when the block raises. durable : also through a power cut, which takes as long as the disk does.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(
        prefix=f".{target.name}.", suffix=".tmp", dir=target.parent
    )
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
            if durable:
                file.flush()
                os.fsync(file.fileno())
        Path(temporary).chmod(0o644)  # mkstemp lets only the owner read
        Path(temporary).replace(target)
    finally:
        Path(temporary).unlink(missing_ok=True)


def write(target: Path, data: bytes) -> None:
    """Puts the whole file there, replacing what was there; see `replacing`."""
    with replacing(target) as file:
        file.write(data)


def shipped(folder: str) -> Path:
    """`schemas`, `pipelines` or `data`: inside the wheel, or beside the package in a checkout."""
    inside = _PACKAGE / folder
    return inside if inside.is_dir() else _PACKAGE.parent / folder
