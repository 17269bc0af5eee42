"""Where bytes lie: whole files that appear at once or not at all.

A part is written in one go (one rename, or one PUT), so a store needs no more than these few
operations.
"""

from functools import cache
from pathlib import Path
from typing import Protocol

import pyarrow as pa

from ..common.errors import RsaDataError


class Store(Protocol):
    """Files below one location; paths are relative, with forward slashes.

    Every method raises RsaDataError for what the user must mend (no space, no permission) and
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
    """The store at a location: a folder, or s3://bucket/prefix."""
    text = str(location)
    if text.startswith("s3://"):
        return _s3_store(text)
    if "://" in text:
        raise RsaDataError(f"--work {text}: expected a folder or s3://BUCKET/PREFIX")
    from .local import LocalStore

    return LocalStore(location)


@cache
def _s3_store(location: str) -> Store:
    """One client a process and location: it takes a tenth of a second to make."""
    from .s3 import S3Store

    return S3Store(location)
