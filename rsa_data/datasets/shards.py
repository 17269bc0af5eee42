"""Members of shards: one image or depth map inside a tar, a zip or a Parquet file, as a path.

`index` keeps where a member lies in the samples' own columns, as SHARD#PLACE+SIZE#NAME below the
root: bytes from PLACE of a tar, the local header of a zip, or row group and row of a Parquet file.
So reading one image needs neither a listing nor the rest of the shard. What such an address means
is checked against the shard each time: one that was replaced since is a failed row.
"""

from __future__ import annotations

import io
import re
from pathlib import Path, PurePosixPath
from typing import cast

from ..common.errors import RowError
from . import parquet_rows, tar_members, zip_members
from .roots import RemotePath
from .shard_file import Shard

_ADDRESS = re.compile(r"(.+\.(tar|zip|parquet))#(\d+)\+(\d+)#(.+)", re.DOTALL)

_READERS = {
    "tar": tar_members.read,
    "zip": zip_members.read,
    "parquet": parquet_rows.read,
}


def address(shard: str, place: int, size: int, name: str) -> str:
    """The path of a member, as the columns `image` and `depth` of samples hold it."""
    return f"{shard}#{place}+{size}#{name}"


def shard_of(path: str) -> str:
    """The shard of a member's path, or the path itself."""
    match = _ADDRESS.fullmatch(path)
    return match[1] if match else path


def name_of(path: str) -> str:
    """The name that an image has in its dataset: of the member of a shard, or the path itself.

    Annotations, label maps and messages go by it, so that they are the same for loose files.
    """
    match = _ADDRESS.fullmatch(path)
    if match is None:
        return path
    return match[5].partition("/")[2] if match[2] == "parquet" else match[5].removeprefix("./")


class Member:
    """A member of a shard, with what reading images uses of a Path."""

    def __init__(self, shard: Path, kind: str, place: int, size: int, name: str):
        self.shard, self.kind, self.place, self.size, self.name = shard, kind, place, size, name

    def __str__(self) -> str:
        return address(str(self.shard), self.place, self.size, self.name)

    @property
    def suffix(self) -> str:
        return PurePosixPath(self.name).suffix

    def read_bytes(self) -> bytes:
        """The member's bytes. Raises RowError when the shard has not what the address says."""
        found = _READERS[self.kind](Shard(self.shard), self.place, self.size, self.name)
        return found

    def open(self, mode: str = "rb") -> io.BytesIO:
        return io.BytesIO(self.read_bytes())


def located(path: Path) -> Path:
    """The path itself, or the Member that it is the address of; both read alike."""
    match = _ADDRESS.fullmatch(text := str(path))
    if match is None:
        return path
    shard: Path = Path(match[1])
    if isinstance(path, RemotePath):
        # The address is the end of the path; what stands before it is the root.
        below = _ADDRESS.fullmatch(str(path.below))
        if below is None:
            raise RowError(f"expected the path of a member below its root, found {text}")
        shard = cast(Path, RemotePath(path.files, PurePosixPath(below[1])))
    return cast(Path, Member(shard, match[2], int(match[3]), int(match[4]), match[5]))
