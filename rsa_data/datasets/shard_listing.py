"""Which shards lie below a root, and the split that a shard's name says."""

import re
from pathlib import Path

from ..common.errors import RsaDataError
from .listing import files_below, paths, require_folder

_SPLIT = re.compile(r"(?:.*/)?(train|test|val)(?:idation)?(?:[-_./].*)?\.\w+")


def find_shards(name: str, root: Path, suffix: str, listed: Path | None) -> list[str]:
    """Paths of the shards below a root, sorted; raises RsaDataError when there is none."""
    if listed is not None:
        found = sorted({path for _, path in paths(listed, name)})
    else:
        require_folder(name, root)
        files = [below + file for below, names in files_below(root) for file in names]
        found = sorted(file for file in files if file.endswith(suffix))
        if not found:
            others = ", ".join(sorted(files)[:4]) or "no file"
            raise RsaDataError(
                f"{name}: {root}: expected shards *{suffix} in it, found {others}"
                + ("; unpack .gz first: what is packed cannot be read from the middle"
                   if any(file.endswith(suffix + ".gz") for file in files) else "")
            )  # fmt: skip
    return found


def split_of(shard: str) -> str:
    """The split that a shard's folder or name says; train where they say none."""
    match = _SPLIT.fullmatch(shard)
    return match[1] if match else "train"
