"""A store in a folder of the file system: temporary file, flush, rename."""

import contextlib
import errno
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from ..common import bounded, files
from ..common.errors import RsaDataError, TransientError
from ..common.failpoints import failpoint


class LocalStore:
    """A folder of the local file system, or of a network file system with atomic rename."""

    at_once = 1

    def __init__(self, folder: Path | str):
        self.folder = Path(folder)
        self.location = str(folder)

    def read(self, path: str) -> bytes | None:
        try:
            return bounded.read(self.folder / path, "record")
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise self._explained("read", path, error) from error

    def open(self, path: str) -> pa.NativeFile:
        try:
            bounded.check_file(self.folder / path)  # a pipe would be waited for
        except bounded.Refused as error:
            raise self._explained("read", path, error) from error
        return pa.memory_map(str(self.folder / path))

    def size(self, path: str) -> int | None:
        try:
            return (self.folder / path).stat().st_size
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise self._explained("read", path, error) from error

    def write(self, path: str, data: bytes | memoryview) -> None:
        try:
            with self._temporary(path, data) as temporary:
                failpoint("rename")
                temporary.replace(self.folder / path)
                failpoint("renamed")
                _flush_folder(temporary.parent)
        except OSError as error:
            raise self._explained("write", path, error) from error

    def create(self, path: str, data: bytes) -> bool:
        try:
            with self._temporary(path, data) as temporary:
                failpoint("rename")
                try:
                    _appear(temporary, self.folder / path)
                except FileExistsError:
                    return self.read(path) == data
                failpoint("renamed")
                _flush_folder(temporary.parent)
        except OSError as error:
            raise self._explained("write", path, error) from error
        return True

    def append(self, path: str, data: bytes) -> None:
        try:
            (self.folder / path).parent.mkdir(parents=True, exist_ok=True)
            with (self.folder / path).open("ab", buffering=0) as file:
                file.write(data)
        except OSError as error:
            raise self._explained("write", path, error) from error

    def finish(self, path: str) -> None:
        """Every line is in the file already."""

    def delete(self, path: str) -> None:
        try:
            (self.folder / path).unlink(missing_ok=True)
        except OSError as error:
            raise self._explained("delete", path, error) from error

    def list(self, folder: str) -> list[str]:
        try:
            found = list(os.scandir(self.folder / folder))
        except (FileNotFoundError, NotADirectoryError):
            return []
        except OSError as error:
            raise self._explained("read", folder, error) from error
        names = [entry.name + ("/" if entry.is_dir() else "") for entry in found]
        return sorted(name for name in names if not name.startswith("."))

    def sweep(self, folder: str) -> None:
        place = self.folder / folder
        _swept.add(place)
        files.sweep(place)

    def free(self) -> int | None:
        place = self.folder.absolute()
        while not place.exists():
            place = place.parent
        return shutil.disk_usage(place).free

    @contextlib.contextmanager
    def _temporary(self, path: str, data: bytes | memoryview) -> Iterator[Path]:
        """A flushed file beside `path`; nothing is left of it at the end, whatever happened."""
        target = self.folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.parent not in _swept:
            self.sweep(path.rpartition("/")[0])
        file, temporary = files.locked_file(target)
        try:
            with file:
                failpoint("write")
                file.write(data)
                failpoint("flush")
                file.flush()
                os.fsync(file.fileno())
                failpoint("flushed")
                yield temporary
        finally:
            temporary.unlink(missing_ok=True)

    def _explained(self, verb: str, path: str, error: OSError) -> RsaDataError:
        what = f"{self.location}: cannot {verb} {path}: {error.strerror or error}"
        if error.errno in _PASSING:
            return TransientError(what + ". This may pass: run the same command again")
        if verb == "read":
            return RsaDataError(what)
        return RsaDataError(
            what + ". What was committed before is valid; run the same command again once this "
            "is fixed."
        )


# What a network file system answers when a server is away or a file was replaced elsewhere.
_PASSING = (errno.EIO, errno.ESTALE, errno.ETIMEDOUT, errno.EAGAIN, errno.EINTR, errno.ENOENT)

# Folders that this process has swept: once before its first write there is enough.
_swept: set[Path] = set()


def _appear(temporary: Path, target: Path) -> None:
    """Gives a file its name unless that is taken (FileExistsError); nobody sees a half of it."""
    try:
        os.link(temporary, target)
    except FileExistsError:
        raise
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.ENOTSUP, errno.ENOSYS):
            raise
        # No hard links there (exFAT, some network mounts): a race between two runs is then
        # decided by the later one, whose bytes are the same.
        if target.exists():
            raise FileExistsError(target) from None
        temporary.replace(target)


def _flush_folder(folder: Path) -> None:
    """Makes a rename last through a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # folders cannot be flushed there
            raise
    finally:
        os.close(descriptor)
