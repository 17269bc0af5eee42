"""The bytes of a shard, near or far: read from front to back in blocks, ahead of who reads."""

from __future__ import annotations

import io
import threading
from collections import OrderedDict
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache, lru_cache
from pathlib import Path
from typing import Protocol

from .roots import RemotePath

# Bytes of one request to a store, and how many of them are kept of one shard: enough for the
# readers of a part, which are at most a few dozen images apart.
BLOCK, _KEPT = 4 << 20, 6


class Spans(Protocol):
    """Where bytes are read from."""

    size: int

    def span(self, start: int, length: int) -> bytes:
        """`length` bytes from `start`, or fewer at the end."""


class Shard:
    """One shard, by its path. Raises OSError as a Path does, the store's errors as a RemotePath."""

    def __init__(self, path: Path):
        self.path = path
        self.bytes: Spans = _blocks(path) if isinstance(path, RemotePath) else _Near(path)

    @property
    def size(self) -> int:
        """Bytes of the whole shard."""
        return self.bytes.size

    def span(self, start: int, length: int) -> bytes:
        """`length` bytes from `start`, or fewer at the end of the shard."""
        return self.bytes.span(start, max(0, min(length, self.size - start)))

    def file(self) -> io.BufferedReader:
        """The whole shard as a file to seek in."""
        return io.BufferedReader(_View(self.bytes), 1 << 16)


# What stands in the place of a shard that was not got, by its first bytes.
_INSTEAD = {
    b"version https://git-lfs": "a pointer of Git LFS in its place; `git lfs pull` gets the file",
    b"<": "a web page or XML, as servers send when one is not logged in",
    b"\x1f\x8b": "a gzip file; unpack it: what is packed cannot be read from the middle",
    b"\x28\xb5\x2f\xfd": "a file packed by Zstandard; unpack it first",
}


def instead(shard: Shard, found: object) -> str:
    """What lies in the place of a shard that cannot be read. found : what its reader says."""
    head = shard.span(0, 64).lstrip()
    for start, what in _INSTEAD.items():
        if head.startswith(start):
            return what
    said = str(found).rstrip(".") if head else "an empty file"
    return f"{said}. Get it again, or move it away"


class _Near:
    def __init__(self, path: Path):
        self.path, self.size = path, path.stat().st_size

    def span(self, start: int, length: int) -> bytes:
        with self.path.open("rb") as file:
            file.seek(start)
            return file.read(length)


class _Blocks:
    """A far shard. Reads that follow each other come from blocks, the next one asked for already;
    a read elsewhere, such as that of one image for a page, is one request for its bytes."""

    def __init__(self, path: RemotePath):
        self.path, self.size = path, path.size()
        self.lock = threading.Lock()
        self.kept: OrderedDict[int, Future[bytes]] = OrderedDict()
        self.last = 0

    def span(self, start: int, length: int) -> bytes:
        if length <= 0:
            return b""
        first, last = start // BLOCK, (start + length - 1) // BLOCK
        with self.lock:
            near = abs(start - self.last) <= BLOCK
            self.last = start + length
            known = all(number in self.kept for number in range(first, last + 1))
            blocks = []
            if near or known:
                blocks = [self._block(number) for number in range(first, last + 1)]
                if (last + 1) * BLOCK < self.size:
                    self._block(last + 1)
        if not blocks:
            return self.path.read_span(start, length)
        try:
            data = b"".join(block.result() for block in blocks)
        except BaseException:
            with self.lock:
                self.kept.clear()  # so that whoever tries again asks again
            raise
        start -= first * BLOCK
        return data[start : start + length]  # at once: a rest of the block would be copied, too

    def _block(self, number: int) -> Future[bytes]:
        if number not in self.kept:
            self.kept[number] = _pool().submit(self.path.read_span, number * BLOCK, BLOCK)
            while len(self.kept) > _KEPT:
                self.kept.popitem(last=False)
        self.kept.move_to_end(number)
        return self.kept[number]


@lru_cache(maxsize=8)
def _blocks(path: RemotePath) -> _Blocks:
    return _Blocks(path)


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(16, thread_name_prefix="shards")


class _View(io.RawIOBase):
    """Spans as a file that can be read and sought in."""

    def __init__(self, spans: Spans):
        self.spans, self.place = spans, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        start = (0, self.place, self.spans.size)[whence]
        self.place = max(0, start + offset)
        return self.place

    def tell(self) -> int:
        return self.place

    def readinto(self, buffer: object) -> int:
        target = memoryview(buffer)  # type: ignore[arg-type]
        length = max(0, min(len(target), self.spans.size - self.place))
        data = self.spans.span(self.place, length) if length else b""
        target[: len(data)] = data
        self.place += len(data)
        return len(data)
