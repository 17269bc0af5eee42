"""sha256 of files."""

import hashlib
from functools import cache
from pathlib import Path

from . import bounded
from .errors import RsaDataError


@cache
def file_sha256(path: str) -> str:
    """sha256 of a file, read once a process."""
    return read_sha256(Path(path))


def read_sha256(path: Path) -> str:
    """sha256 of a file as it is now; RsaDataError for one over the limit `model`, or a pipe."""
    try:
        with bounded.opened(path, "model") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except bounded.Refused as error:
        raise RsaDataError(f"{path}: {error}") from error
