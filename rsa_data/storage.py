"""Where bytes lie: whole files that appear at once or not at all.

A part is written in one go (one rename, or one PUT), so a store needs no more than these few
operations. `failpoint` names the moments between them, for tests that kill the process there.
"""

import os
import secrets
import signal
import socket
from pathlib import Path
from typing import Protocol

import pyarrow as pa

from .errors import RsaDataError

_hits: dict[str, int] = {}


def failpoint(moment: str) -> None:
    """Kills this process when RSA_DATA_FAILPOINT names this moment (`rename`, or `rename:3`).

    With a number the third time counts, so that a test can reach a later part. Nothing else
    happens here.
    """
    wanted, _, nth = os.environ.get("RSA_DATA_FAILPOINT", "").partition(":")
    if wanted == moment:
        _hits[moment] = _hits.get(moment, 0) + 1
        if _hits[moment] == int(nth or 1):
            os.kill(os.getpid(), signal.SIGKILL)


class Store(Protocol):
    """Files below one location; paths are relative, with forward slashes."""

    location: str

    def read(self, path: str) -> bytes | None:
        """The whole file, or None when there is none."""

    def open(self, path: str) -> pa.NativeFile:
        """The file for reading Arrow or Parquet from; raises FileNotFoundError."""

    def size(self, path: str) -> int | None:
        """Bytes of the file, or None when there is none."""

    def write(self, path: str, data: bytes | memoryview) -> None:
        """Puts the whole file there, replacing what was there; readers see the old or the new."""

    def create(self, path: str, data: bytes) -> bool:
        """Puts the file there only if there is none yet; False when there was one."""

    def delete(self, path: str) -> None:
        """Removes the file; nothing happens when there is none."""

    def list(self, folder: str) -> list[str]:
        """Names of the files and folders (with a slash at their end) in `folder`, sorted."""


class LocalStore:
    """A folder of the local file system, or of a network file system with atomic rename."""

    def __init__(self, folder: Path | str):
        self.folder = Path(folder)
        self.location = str(folder)

    def read(self, path: str) -> bytes | None:
        try:
            return (self.folder / path).read_bytes()
        except FileNotFoundError:
            return None

    def open(self, path: str) -> pa.NativeFile:
        return pa.memory_map(str(self.folder / path))

    def size(self, path: str) -> int | None:
        try:
            return (self.folder / path).stat().st_size
        except FileNotFoundError:
            return None

    def write(self, path: str, data: bytes | memoryview) -> None:
        temporary = self._temporary(path, data)
        failpoint("rename")
        temporary.replace(self.folder / path)
        _flush_folder(temporary.parent)
        failpoint("renamed")

    def create(self, path: str, data: bytes) -> bool:
        temporary = self._temporary(path, data)
        try:
            # A link appears whole or fails: unlike open(..., "x"), nobody sees a half of it.
            os.link(temporary, self.folder / path)
        except FileExistsError:
            return False
        finally:
            temporary.unlink()
        _flush_folder(temporary.parent)
        return True

    def delete(self, path: str) -> None:
        (self.folder / path).unlink(missing_ok=True)

    def list(self, folder: str) -> list[str]:
        try:
            found = list(os.scandir(self.folder / folder))
        except (FileNotFoundError, NotADirectoryError):
            return []
        names = [entry.name + ("/" if entry.is_dir() else "") for entry in found]
        return sorted(name for name in names if not name.startswith("."))

    def _temporary(self, path: str, data: bytes | memoryview) -> Path:
        """A flushed file beside `path` whose name tells who wrote it."""
        target = self.folder / path
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            self._clean(target.parent)
            failpoint("write")
            name = f".{target.name}.{socket.gethostname()}.{os.getpid()}.{secrets.token_hex(4)}.tmp"
            temporary = target.with_name(name)
            try:
                with temporary.open("wb") as file:
                    file.write(data)
                    failpoint("flush")
                    file.flush()
                    os.fsync(file.fileno())
            except BaseException:
                temporary.unlink(missing_ok=True)
                raise
        except OSError as error:
            raise RsaDataError(
                f"{self.location}: cannot write {path}: {error.strerror or error}. What was "
                "committed before is valid; run the same command again once this is mended."
            ) from error
        return temporary

    @staticmethod
    def _clean(folder: Path) -> None:
        """Removes temporary files that a process of this machine left behind when it died."""
        for stale in folder.glob(".*.tmp"):
            host, process = stale.name.split(".")[-4:-2]
            if host == socket.gethostname() and not Path(f"/proc/{process}").exists():
                stale.unlink(missing_ok=True)


def _flush_folder(folder: Path) -> None:
    """Makes a rename last through a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def open_store(location: str | Path) -> Store:
    """The store at a location: a folder."""
    if "://" in str(location):
        raise RsaDataError(f"--work {location}: expected a folder")
    return LocalStore(location)
