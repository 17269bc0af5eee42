"""The one reader of what comes from outside: no more than its limit, whatever a file claims to be.

Every limit stands in LIMITS. The environment variable RSA_DATA_LIMITS changes them, for one command
or for good: RSA_DATA_LIMITS=image=2GB,request=60s.

Whatever is refused here is a `Refused`, which is an OSError and a ValueError: callers that expect a
file they cannot read, or text that is not of its form, handle it as they handle those.
"""

import errno
import io
import json
import os
import re
import stat
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from . import text_files
from .errors import RsaDataError, UsageError
from .numbers import real
from .units import parse_size, size

_LONG_KEY = re.compile(r"""(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){64}""")

VARIABLE = "RSA_DATA_LIMITS"

LIMITS: dict[str, float] = {
    # Bytes of one image, depth map, label map or cloud of points: a raw photo of 100 million
    # pixels is smaller.
    "image": 512e6,
    # Bytes of a file of names, paths, captions or a prompt: about half a million paths.
    "text": 32e6,
    # Bytes of memory that the values of a JSON or CSV file take.
    "json": 1.2e9,
    # Bytes of a TOML file; the parser is slow.
    "toml": 1e6,
    # Characters of one caption: encoders read some hundreds.
    "caption": 100e3,
    # Bytes of a file that is hashed or loaded, not read whole: weights of a model.
    "model": 16e9,
    # Seconds that the download of a model may take in all.
    "download": 4 * 3600.0,
    # Bytes of memory that the names in one folder of a bucket may take: some million names.
    "listing": 500e6,
    # Bytes of a file of a work dir that is read whole: a description, a manifest, a head.
    "record": 512e6,
    # Bytes of a server's answer that is not a file: JSON, or a page that lists a folder.
    "answer": 16e6,
    # Seconds that one request may take in all, from the first byte sent to the last one read.
    "request": 300.0,
}

# Which of them are seconds.
TIMES = frozenset({"request", "download"})


class Refused(OSError, ValueError):
    """A file, text or answer over a limit, or of a kind that is never read. str() says which."""

    def __init__(self, text: str):
        super().__init__(errno.EFBIG, text)

    def __str__(self) -> str:
        return str(self.strerror)


def limit(name: str) -> float:
    """A limit by its name; raises UsageError when RSA_DATA_LIMITS makes no sense."""
    return _limits(os.environ.get(VARIABLE, ""))[name]


@cache
def _limits(text: str) -> dict[str, float]:
    found = dict(LIMITS)
    for item in filter(None, text.split(",")):
        name, _, value = item.strip().partition("=")
        if name not in LIMITS:
            raise UsageError(
                f"{VARIABLE}: expected NAME=VALUE with a name of {', '.join(LIMITS)}; "
                f"found {item!r}"
            )
        try:
            amount = real(value.removesuffix("s")) if name in TIMES else parse_size(value, "")
        except (ValueError, RsaDataError) as error:
            raise UsageError(
                f"{VARIABLE}: {name}: expected "
                + ("seconds, such as 60s" if name in TIMES else "a size, such as 2GB")
                + f"; found {value!r}"
            ) from error
        if not 0 < amount < float("inf"):
            raise UsageError(f"{VARIABLE}: {name}: expected more than 0; found {value!r}")
        found[name] = amount
    return found


def over(name: str, found: float) -> Refused:
    """The error for more bytes than a limit allows, with the way to raise it."""
    return Refused(
        f"expected at most {size(limit(name))}, found {'about ' if name == 'json' else ''}"
        f"{size(found)}; {VARIABLE}={name}=SIZE raises the limit"
    )


def read(path: Path, kind: str) -> bytes:
    """The bytes of a file, at most those of the limit `kind`.

    path : a Path, or what reads like one; see datasets.roots. Pipes, sockets and devices are
        refused unread, since they may never end. Raises OSError as opening a file does, Refused
        for a file over the limit.
    """
    most = int(limit(kind))
    if not isinstance(path, Path):
        with path.open("rb") as file:
            data: bytes = file.read(most + 1)
    else:
        with opened(path, kind) as file:
            there = os.fstat(file.fileno()).st_size
            data = file.read(there + 1)
            if len(data) > there:  # a file that grows, or one of /proc, which says 0
                data += file.read(most + 1 - len(data))
    if len(data) > most:
        raise over(kind, len(data))
    return data


@contextmanager
def opened(path: Path, kind: str) -> Iterator[io.BufferedReader]:
    """A file to read from, which holds no more than the limit `kind` when it is opened."""
    # Asked first: opening a pipe waits for somebody who writes.
    check_file(path)
    with open(path, "rb", opener=_opener) as file:
        if (there := os.fstat(file.fileno()).st_size) > limit(kind):
            raise over(kind, there)
        yield file


def _opener(path: str, flags: int) -> int:
    # A pipe that took the file's place meanwhile is not waited for either.
    return os.open(path, flags | os.O_NONBLOCK)


def check_file(path: Path) -> None:
    """Raises Refused for a pipe, a socket or a device, OSError where nothing is."""
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise Refused("expected a file, found a pipe, socket or device")


def read_text(path: Path, kind: str = "text") -> str:
    """The text of a UTF-8 file without a byte-order mark; Refused also where it is no UTF-8."""
    try:
        return text_files.decode(read(path, kind))
    except Refused:
        raise
    except ValueError as error:
        raise Refused(f"expected UTF-8 text; found {error}") from error


def check_captions(texts: Iterable[str], where: str) -> None:
    """Raises RsaDataError for a text of more characters than the limit `caption`, or of none that
    UTF-8 can hold, as bytes of a command line become."""
    most = limit("caption")
    for text in texts:
        if not text_files.encodable(text):
            raise RsaDataError(f"{where}: expected UTF-8 text; found {text[:40]!r}")
        if len(text) > most:
            raise RsaDataError(
                f"{where}: expected captions of at most {most:,.0f} characters, found one of "
                f"{len(text):,}, {text[:40]!r}...; {VARIABLE}=caption=NUMBER raises the limit"
            )


def read_json(path: Path, kind: str = "json") -> Any:
    """The value of a JSON file; see parse_json."""
    return parse_json(read(path, kind))


def parse_json(data: bytes | str) -> Any:
    """The value of JSON text. Raises ValueError alone: also for nesting and numbers without end,
    and Refused before its values would take more memory than the limit `json`."""
    marks = ("[", "{", ",") if isinstance(data, str) else (b"[", b"{", b",")
    lists, objects, items = (data.count(mark) for mark in marks)  # type: ignore[arg-type]
    # An empty list of Python takes 56 bytes and a place of 8, an object 64 to 232, a number 24.
    needed = 2 * len(data) + 64 * lists + 160 * objects + 40 * items
    if needed > limit("json"):
        raise over("json", needed)
    try:
        return json.loads(data)
    except RecursionError as error:
        raise ValueError("values nested too deep") from error


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file. Raises OSError, or ValueError for text that is no TOML."""
    return parse_toml(read_text(path, "toml"))


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of TOML text. Raises ValueError alone, with its reason."""
    # The parser keeps every beginning of a dotted key: memory by the square of its length.
    if _LONG_KEY.search(text):
        raise ValueError("a dotted key of more than 64 steps")
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("values nested too deep") from error
