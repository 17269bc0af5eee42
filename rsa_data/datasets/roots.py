"""Where a dataset's files lie: a folder, or the same layout in a bucket or on a web server."""

from __future__ import annotations

import errno
import fnmatch
import io
import os
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any, cast

from ..common.errors import UsageError
from ..common.text_files import encodable
from ..store.stores import Files, open_files


def open_root(text: str | Path) -> Path:
    """The root at a place: a folder, s3://, gs://, az:// or https://.

    What is not a folder comes as a RemotePath, which reads like a Path. Raises RsaDataError for an
    address of another kind, UsageError for a name that is no UTF-8: the work dir keeps it as text.
    """
    place = str(text)
    if not encodable(place):
        raise UsageError(f"root: expected a name in UTF-8; found {place!r}")
    if "://" not in place:
        return Path(place)
    return cast(Path, RemotePath(open_files(place), PurePosixPath()))


def is_remote(root: Path | None) -> bool:
    """Whether a root lies in a bucket or on a web server."""
    return isinstance(root, RemotePath)


def readers(root: Path | None) -> int:
    """Threads that read files below `root`: they decode, and wait for answers where it is far."""
    return 16 if is_remote(root) else 2


class RemotePath:
    """A file or folder of a store, with what datasets use of pathlib.Path for reading.

    A folder is there when it holds something. OSError means what it does for a Path; the store's
    own errors pass through.
    """

    def __init__(self, files: Files, below: PurePosixPath, folder: bool | None = None):
        self.files, self.below, self._folder = files, below, folder

    def __str__(self) -> str:
        return f"{self.files.location}/{self.below}" if self.below.parts else self.files.location

    def __repr__(self) -> str:
        return f"RemotePath({str(self)!r})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RemotePath) and str(self) == str(other)

    def __hash__(self) -> int:
        return hash(str(self))

    def __lt__(self, other: RemotePath) -> bool:
        return str(self) < str(other)

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (self.files.location, str(self.below))

    def __truediv__(self, name: str | PurePosixPath) -> RemotePath:
        return RemotePath(self.files, self.below / name)

    @property
    def name(self) -> str:
        return self.below.name or self.files.location.rpartition("/")[2]

    @property
    def suffix(self) -> str:
        return PurePosixPath(self.name).suffix

    @property
    def parent(self) -> RemotePath:
        """The folder above; nothing is above the root."""
        return RemotePath(self.files, self.below.parent)

    @property
    def parents(self) -> list[RemotePath]:
        return [RemotePath(self.files, above) for above in self.below.parents]

    def with_name(self, name: str) -> RemotePath:
        return RemotePath(self.files, self.below.with_name(name))

    def relative_to(self, other: RemotePath) -> PurePosixPath:
        return self.below.relative_to(other.below)

    def is_dir(self) -> bool:
        return bool(self.files.list(self._path)) if self._folder is None else self._folder

    def is_file(self) -> bool:
        if self._folder is None:
            return bool(self.below.parts) and self.files.size(self._path) is not None
        return not self._folder

    def exists(self) -> bool:
        return self._folder is not None or self.is_file() or self.is_dir()

    def iterdir(self) -> Iterator[RemotePath]:
        for name in self.files.list(self._path):
            if name.strip("/") not in ("", ".", ".."):  # keys of a bucket may have such steps
                yield RemotePath(self.files, self.below / name, folder=name.endswith("/"))

    def glob(self, pattern: str) -> Iterator[RemotePath]:
        """Paths whose names match, folder by folder; `**` is not known."""
        first, _, rest = pattern.partition("/")
        for path in self.iterdir():
            if fnmatch.fnmatchcase(path.name, first):
                if not rest:
                    yield path
                elif path.is_dir():
                    yield from path.glob(rest)

    def read_bytes(self) -> bytes:
        return self._there(self.files.read(self._path))

    def read_head(self, most: int) -> bytes:
        """The first `most` bytes, or fewer where the file is shorter."""
        return self._there(self.files.head(self._path, most))

    def read_span(self, start: int, length: int) -> bytes:
        """`length` bytes from `start`, or fewer at the end of the file."""
        return self._there(self.files.span(self._path, start, length))

    def size(self) -> int:
        """Bytes of the file."""
        found = self.files.size(self._path)
        if found is None:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(self))
        return found

    def read_text(self, encoding: str = "utf-8", errors: str = "strict") -> str:
        return self.read_bytes().decode(encoding, errors)

    def open(self, mode: str = "rb") -> io.BytesIO:
        return io.BytesIO(self.read_bytes())

    def _there(self, data: bytes | None) -> bytes:
        if data is None:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(self))
        return data

    @property
    def _path(self) -> str:
        return str(self.below) if self.below.parts else ""


def _again(location: str, below: str) -> RemotePath:
    return RemotePath(open_files(location), PurePosixPath(below))
