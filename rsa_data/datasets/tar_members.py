"""Tar shards: which files they hold and where, and the bytes of one of them."""

import re
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass

from ..common.errors import RowError, RsaDataError
from .shard_file import Shard, instead

_HEADER = tarfile.BLOCKSIZE

# A sample's key is its name up to the first dot after the last slash, as WebDataset cuts it.
_NAME = re.compile(r"((?:.*/)?[^/.]+)\.([^/]+)", re.DOTALL)


@dataclass(frozen=True)
class Entry:
    """A file of a shard. place : where its bytes begin (tar), or its local header (zip)."""

    name: str
    place: int
    size: int


def split_name(name: str) -> tuple[str, str] | None:
    """(key, ending in small letters) of a member's name; None for one that is of no sample.

    WebDataset leaves these out as well: hidden files, and those without an ending.
    """
    match = _NAME.fullmatch(name)
    return None if match is None else (match[1].removeprefix("./"), match[2].lower())


def entries(shard: Shard) -> Iterator[Entry]:
    """The files of a tar, in its order.

    Raises RsaDataError for a tar that is cut or damaged, or holds links, sparse files or devices:
    what follows in it could not be told from what is missing.
    """
    try:
        with tarfile.open(fileobj=shard.file(), mode="r:", errors="strict") as tar:
            while (member := tar.next()) is not None:
                tar.members = []  # type: ignore[attr-defined]  # tarfile keeps them for no use here
                if member.isdir():
                    continue
                if not member.isreg() or member.issparse():
                    kinds = {b"1": "a hard link", b"2": "a symbolic link"}
                    kind = kinds.get(
                        member.type, "a device, a sparse file or another special entry"
                    )
                    raise _broken(shard, f"files alone, found {kind}: {member.name!r}")
                if member.offset_data + member.size > shard.size:
                    raise _broken(
                        shard,
                        f"{member.size:,} bytes of {member.name!r} from byte "
                        f"{member.offset_data:,}; it ends at {shard.size:,}",
                    )
                yield Entry(member.name, member.offset_data, member.size)
            end = tar.offset
    except (tarfile.TarError, UnicodeError, ValueError, OverflowError) as error:
        raise RsaDataError(
            f"{shard.path}: expected a tar, found: {instead(shard, error)}"
        ) from error
    # tarfile takes a damaged header for the end.
    if shard.span(end, _HEADER).strip(b"\0") or end + _HEADER > shard.size:
        found = "a damaged header" if end + _HEADER <= shard.size else "the end of the file"
        raise _broken(
            shard, f"the next entry or the end of the archive at byte {end:,}, found {found}"
        )


def read(shard: Shard, place: int, size: int, name: str) -> bytes:
    """The bytes of a file of a tar. Raises RowError where the shard has another one there."""
    try:
        data = shard.span(place - _HEADER, size + _HEADER)
    except (FileNotFoundError, NotADirectoryError):
        raise RowError(f"no such shard: {shard.path.name}") from None
    try:
        header = tarfile.TarInfo.frombuf(data[:_HEADER], "utf-8", "surrogateescape")
        # Longer and other names stand in a header of their own before this one.
        plain = name.isascii() and len(name) <= 100
        same = header.size == size and (header.name == name or not plain)
    except tarfile.HeaderError:
        same = False
    if not same:
        raise RowError(f"expected {name} at byte {place} of {shard.path.name}, found another")
    if len(data) < size + _HEADER:
        raise RowError(f"expected {size} bytes of {name} in {shard.path.name}, found a cut file")
    return data[_HEADER:]


def _broken(shard: Shard, what: str) -> RsaDataError:
    return RsaDataError(f"{shard.path}: expected {what}. Get it again, or move it away")
