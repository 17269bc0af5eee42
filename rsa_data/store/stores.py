"""Where bytes lie: whole files that appear at once or not at all.

A part is written in one go (one rename, or one PUT), so a store needs no more than these few
operations. A store is found by the scheme of its location, in registry.STORES.
"""

from functools import cache
from pathlib import Path
from typing import Protocol, runtime_checkable

import pyarrow as pa

from .. import registry
from ..common.errors import RsaDataError, UsageError
from ..common.text_files import encodable
from .local import LocalStore


class Files(Protocol):
    """What reading takes of a store: paths are relative, with forward slashes."""

    location: str

    def read(self, path: str) -> bytes | None:
        """The whole file, or None when there is none."""

    def head(self, path: str, most: int) -> bytes | None:
        """The first `most` bytes of the file, or None when there is none."""

    def span(self, path: str, start: int, length: int) -> bytes | None:
        """`length` bytes of the file from `start`, fewer at its end; None when there is none."""

    def size(self, path: str) -> int | None:
        """Bytes of the file, or None when there is none."""

    def list(self, folder: str) -> list[str]:
        """Names of the files and folders (with a slash at their end) in `folder`, sorted."""


@runtime_checkable
class Store(Protocol):
    """Files below one location; paths are relative, with forward slashes.

    Every method raises RsaDataError for what the user must fix (no space, no permission) and
    TransientError for what may pass by itself.
    """

    location: str
    # Requests that are best made side by side: 1 where each is answered at once.
    at_once: int

    def read(self, path: str) -> bytes | None:
        """The whole file, or None when there is none."""

    def open(self, path: str) -> pa.NativeFile:
        """The file for reading Arrow or Parquet from; raises FileNotFoundError."""

    def size(self, path: str) -> int | None:
        """Bytes of the file, or None when there is none."""

    def write(self, path: str, data: bytes | memoryview) -> None:
        """Puts the whole file there, replacing what was there; readers see the old or the new."""

    def create(self, path: str, data: bytes) -> bool:
        """Puts the file there only if there is none yet; False when there was another one."""

    def append(self, path: str, data: bytes) -> None:
        """Adds to a log file; it may be seen late, and its end may be lost in a crash."""

    def finish(self, path: str) -> None:
        """Nothing more will be appended to this log file."""

    def delete(self, path: str) -> None:
        """Removes the file; nothing happens when there is none."""

    def list(self, folder: str) -> list[str]:
        """Names of the files and folders (with a slash at their end) in `folder`, sorted."""

    def sweep(self, folder: str) -> None:
        """Removes what writers that died left behind in `folder`."""

    def free(self) -> int | None:
        """Bytes that can still be written; None when that is not known."""


def open_store(location: str | Path) -> Store:
    """The store of a work dir: a folder, or s3://, gs:// or az://.

    Raises UsageError for no name at all, and for one that is no UTF-8: commands print it.
    """
    text = str(location)
    if not text or not encodable(text):
        raise UsageError(f"--work: expected the name of a folder in UTF-8; found {text!r}")
    if "://" not in text:
        return LocalStore(location)
    store = _opened(text, "--work")
    if not isinstance(store, Store):
        raise RsaDataError(
            f"--work {text}: expected a place that can be written: a folder, s3://BUCKET/PREFIX, "
            "gs://BUCKET/PREFIX or az://CONTAINER/PREFIX"
        )
    return store


def open_files(location: str) -> Files:
    """What lies at an address such as s3://BUCKET/PREFIX or https://HOST/PATH, to read."""
    return _opened(location, "--root")


@cache
def _opened(location: str, option: str) -> Files:
    """One client a process and location: it takes a tenth of a second to make."""
    scheme = location.partition("://")[0]
    if scheme not in registry.STORES:
        known = ", ".join(f"{name}://" for name in registry.STORES)
        raise RsaDataError(f"{option} {location}: expected a folder or one of {known}")
    found: Files = registry.resolve("store", registry.STORES, scheme)(location, option)
    return found
