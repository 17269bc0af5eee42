"""sha256 of files."""

import hashlib
import time
from functools import cache
from pathlib import Path

from . import bounded
from .errors import RsaDataError

# s after its last change in which a file may change once more and keep its times: file systems
# count them in steps of up to 2 s.
_SETTLED = 2.5


def file_sha256(path: str) -> str:
    """sha256 of a file, read once a process and again when it was changed or replaced."""
    try:
        now = Path(path).stat()
    except OSError:
        return read_sha256(Path(path))
    if abs(time.time() - max(now.st_mtime, now.st_ctime)) < _SETTLED:
        return read_sha256(Path(path))
    return _sha256(path, now.st_dev, now.st_ino, now.st_size, now.st_mtime_ns, now.st_ctime_ns)


@cache
def _sha256(path: str, *state: int) -> str:
    return read_sha256(Path(path))


def read_sha256(path: Path) -> str:
    """sha256 of a file as it is now; RsaDataError for one over the limit `model`, or a pipe."""
    try:
        with bounded.opened(path, "model") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except bounded.Refused as error:
        raise RsaDataError(f"{path}: {error}") from error
