"""Texts that lie beside images in shards: members of the same key, or a column of the same row."""

from functools import lru_cache
from pathlib import Path

from ..common import text_files
from ..common.bounded import limit
from ..common.errors import RowError, RsaDataError
from . import parquet_rows, tar_members, zip_members
from .shard_file import Shard
from .shards import Member, located
from .tar_members import Entry, split_name

_KINDS = {
    "tar": (tar_members.entries, tar_members.read),
    "zip": (zip_members.entries, zip_members.read),
}

# Bytes of a text that is read while the shard is listed; a longer one is read when it is needed.
_SHORT = 1 << 14


def texts_beside(root: Path, image: str, ending: str) -> list[str]:
    """The lines of the text that belongs to an image of a shard; [] where it has none.

    image : its path in samples. ending : of the members that hold texts, such as txt; of Parquet
    files the column, with a text or a list of texts in each row.

    Raises RowError for a text that is not UTF-8, RsaDataError when the image is not in a shard or
    the shard is damaged.
    """
    member = located(root / image)
    if not isinstance(member, Member):
        raise RsaDataError(
            f"expected images in shards (webdataset, zip or parquet), found the file {image}. "
            "The style import:DIR reads texts that lie beside loose files"
        )
    shard = Shard(member.shard)
    if member.kind == "parquet":
        return parquet_rows.texts(shard, member.place, member.size, ending)
    split = split_name(member.name)
    texts = _texts(member.shard, shard.size, member.kind, ending.lower())
    found = texts.get(split[0], b"") if split is not None else b""
    if isinstance(found, Entry):
        if found.size > limit("text"):
            raise RowError(f"{found.name}: expected a text, found {found.size:,} bytes")
        found = _KINDS[member.kind][1](shard, found.place, found.size, found.name)
    try:
        return text_files.lines(text_files.decode(found))
    except ValueError as error:
        raise RowError(f"the member .{ending}: expected text in UTF-8, found {error}") from error


@lru_cache(2)  # images of a part come in the order of their shard
def _texts(path: Path, size: int, kind: str, ending: str) -> dict[str, bytes | Entry]:
    """By key, the texts of a shard of so many bytes."""
    entries, read = _KINDS[kind]
    shard, found = Shard(path), dict[str, bytes | Entry]()
    for entry in entries(shard):
        split = split_name(entry.name)
        if split is not None and split[1] == ending:
            short = entry.size <= _SHORT
            found[split[0]] = read(shard, entry.place, entry.size, entry.name) if short else entry
    return found
