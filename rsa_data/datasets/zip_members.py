"""Zip shards: which files they hold and where, and the bytes of one of them."""

import struct
import zipfile
import zlib
from collections.abc import Iterator

from ..common.bounded import limit
from ..common.errors import RowError, RsaDataError
from .shard_file import Shard, instead
from .tar_members import Entry

# The local file header of APPNOTE.TXT, section 4.3.7: signature, version, flags, method, time,
# date, CRC, compressed size, size, length of the name and of the extra field.
_HEADER = struct.Struct("<4s5H3I2H")
_SIGNATURE = b"PK\3\4"
# What name and extra field take at most in practice; longer ones cost another read.
_NAMES = 1024


def entries(shard: Shard) -> Iterator[Entry]:
    """The files of a zip, in the order of its directory; sizes are those inside the archive.

    Raises RsaDataError for a zip that is cut or damaged, or holds encrypted files or files of
    another compression than deflate.
    """
    try:
        with zipfile.ZipFile(shard.file()) as archive:
            for info in archive.infolist():
                if info.is_dir():
                    continue
                if info.flag_bits & 1 or info.compress_type not in (0, 8):
                    raise RsaDataError(
                        f"{shard.path}: expected files stored or deflated, found {info.filename!r} "
                        "encrypted or of another method. Write it again"
                    )
                if info.header_offset + info.compress_size > shard.size:
                    raise zipfile.BadZipFile(f"{info.filename!r} lies beyond the end of the file")
                yield Entry(info.filename, info.header_offset, info.compress_size)
    except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise RsaDataError(
            f"{shard.path}: expected a zip, found: {instead(shard, error)}"
        ) from error


def read(shard: Shard, place: int, size: int, name: str) -> bytes:
    """The bytes of a file of a zip. Raises RowError where the shard has another one there."""
    data = shard.span(place, _HEADER.size + _NAMES + size)
    if len(data) < _HEADER.size or not data.startswith(_SIGNATURE):
        raise _other(shard, place, name)
    _, _, flags, method, _, _, crc, _, plain, names, extra = _HEADER.unpack_from(data)
    encoding = "utf-8" if flags & 0x800 else "cp437"
    found = data[_HEADER.size : _HEADER.size + names].decode(encoding, "replace")
    if found != name:
        raise _other(shard, place, name)
    start = _HEADER.size + names + extra
    if start + size > len(data):
        data = shard.span(place, start + size)
    packed = data[start : start + size]
    if len(packed) < size:
        raise RowError(f"expected {size} bytes of {name} in {shard.path.name}, found a cut file")
    if method == 0:
        content = packed
    else:
        most = int(limit("image"))
        unpack = zlib.decompressobj(-zlib.MAX_WBITS)
        try:
            content = unpack.decompress(packed, most)
        except zlib.error as error:
            raise RowError(f"unreadable {name} in {shard.path.name}: {error}") from error
        if unpack.unconsumed_tail:
            raise RowError(f"expected at most {most} bytes of {name}, found more")
    # With bit 3 the sum stands behind the data, and zeros in the header.
    if not flags & 8 and (zlib.crc32(content) != crc or len(content) != plain):
        raise RowError(f"the checksum of {name} in {shard.path.name} is wrong")
    return content


def _other(shard: Shard, place: int, name: str) -> RowError:
    return RowError(f"expected {name} at byte {place} of {shard.path.name}, found another")
