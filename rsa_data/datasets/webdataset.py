"""Images in tar or zip shards, as WebDataset, img2dataset and NeMo Curator write them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa

from ..common.errors import RowError, RsaDataError, UsageError
from ..common.ranges import PositiveAmount
from . import left_out, tar_members, zip_members
from .dataset import Dataset, Shards
from .depth_files import UNITS, any_file
from .folder import scene
from .images import SUFFIXES
from .listing import Sample, inside
from .shard_file import Shard
from .shard_listing import find_shards, index_of, shard_table, split_of
from .shard_records import camera_of, read_json, text_of
from .shards import address
from .tar_members import Entry, split_name


@dataclass(frozen=True)
class Members:
    """Which members, and which fields of their JSON, a sample of a tar or zip is made of.

    image : ending of the members that are images, what follows the first dot of their names, such
        as jpg or rgb.png. Without it, the one member of a sample that ends like an image.
    depth : ending of the members with depth, 16-bit PNG, TIFF or .npy, such as depth.png.
    depth_unit : unit of the depth files: m, cm, mm, or m/N for N steps a metre (m/256, m/5000).
    scene : field of a sample's .json member that names its scene. Without it, the key's folder.
    split : field of a sample's .json member that names its split. Without it, a shard is of the
        split that its folder or the start of its name says (val/, test-00000.tar), else train.
    intrinsics : field of a sample's .json member with fx, fy, cx, cy or the 3 x 3 matrix, in px.
    keys : member: sample ids are the keys of members. shard/member: the shard's name comes first,
        where keys repeat from shard to shard.
    file_list : file with the paths of the shards to take, below the root, one a line; for a web
        server that does not list its folders, or a part of a large folder.
    min_depth : m, smaller depth counts as none.
    max_depth : m, larger depth counts as none.
    """

    image: str | None = None
    depth: str | None = None
    depth_unit: str | None = None
    scene: str | None = None
    split: str | None = None
    intrinsics: str | None = None
    keys: Literal["member", "shard/member"] = "member"
    file_list: Path | None = None
    min_depth: PositiveAmount = 1e-3
    max_depth: PositiveAmount = 80.0


def webdataset(*, members: Members = Members()) -> Dataset:
    """Tar shards, as WebDataset and img2dataset write them; a part is a shard, read from its front.

    Parameters
    ----------
    members : which members and fields a sample is made of.
    """
    return _dataset("webdataset", ".tar", tar_members.entries, members)


def zipped(*, members: Members = Members()) -> Dataset:
    """Zip files with images in them, as archives of datasets come; nothing is unpacked.

    Parameters
    ----------
    members : which members and fields a sample is made of.
    """
    return _dataset("zip", ".zip", zip_members.entries, members)


def _dataset(
    name: str, suffix: str, entries: Callable[[Shard], Iterator[Entry]], members: Members
) -> Dataset:
    limits = (members.min_depth, members.max_depth)
    find = partial(find_shards, name, suffix=suffix, listed=members.file_list)
    shards = Shards(find, partial(_read, name, entries, members))
    return Dataset(
        name=name,
        index=partial(index_of, name, shards),
        read_depth=shard_depth(name, members.depth, members.depth_unit, limits),
        min_depth=members.min_depth,
        max_depth=members.max_depth,
        scene=scene,
        shards=shards,
    )


def shard_depth(
    name: str, depth: str | None, unit: str | None, limits: tuple[float, float]
) -> Callable[[Path], np.ndarray]:
    """The reader of ground truth in shards; raises UsageError unless depth and unit go together."""
    if (depth is None) != (unit is None):
        raise UsageError(
            f"{name}: depth and depth_unit go together: what holds depth, and one of the units "
            f"{', '.join(UNITS)} or m/N, N steps a metre; no unit is ever guessed"
        )
    if not 0 < limits[0] < limits[1]:
        raise UsageError(
            f"{name}: expected 0 < min_depth < max_depth, found {limits[0]} and {limits[1]}"
        )
    return no_depth if unit is None else any_file(unit, f"{name}: depth_unit")


def no_depth(path: Path) -> np.ndarray:
    """In place of a reader of ground truth where the dataset has none."""
    raise RowError("the dataset was indexed without depth")


def _read(
    name: str,
    entries: Callable[[Shard], Iterator[Entry]],
    fields: Members,
    root: Path,
    shard: str,
) -> pa.Table:
    members = _members(entries, Shard(root / shard), f"{name}: {shard}")
    samples = [_sample(root, shard, fields, key, parts) for key, parts in members.items()]
    without = {
        key: parts
        for (key, parts), sample in zip(members.items(), samples, strict=True)
        if sample.image is None
    }
    table = shard_table(name, root, samples)
    return left_out.without_image(table, shard, without, fields.image)


def _members(
    entries: Callable[[Shard], Iterator[Entry]], file: Shard, where: str
) -> dict[str, dict[str, Entry]]:
    """The members of each sample of one shard by their endings, in its order."""
    members: dict[str, dict[str, Entry]] = {}
    for entry in entries(file):
        if (split := split_name(entry.name)) is None:
            continue
        key, ending = split
        inside(key if key[0] != "/" else f"/{key}", where)
        if members.setdefault(key, {}).setdefault(ending, entry) is not entry:
            raise RsaDataError(
                f"{where}: expected one member {key}.{ending}, found two. Write the shard again"
            )
    return members


def _sample(root: Path, shard: str, fields: Members, key: str, parts: dict[str, Entry]) -> Sample:
    where = f"{shard}: {key}"
    image = fields.image
    if image is None:
        found = [ending for ending in parts if f".{ending}" in SUFFIXES]
        if len(found) > 1:
            raise UsageError(
                f"{where}: expected one image, found {', '.join(found)}: say which by "
                "--dataset-option image=ENDING"
            )
        image = found[0] if found else ""
    about: dict[str, Any] = {}
    if fields.scene or fields.split or fields.intrinsics:
        about = read_json(root, shard, parts.get("json"), where)
    stem = shard.rpartition("/")[2].partition(".")[0]
    key = key if fields.keys == "member" else f"{stem}/{key}"
    return Sample(
        split=text_of(about, fields.split, where) or split_of(shard),
        key=key,
        scene=text_of(about, fields.scene, where) or scene(key),
        image=_address(shard, parts.get(image.lower())),
        depth=_address(shard, parts.get((fields.depth or "").lower())),
        camera=camera_of(about, fields.intrinsics, where),
    )


def _address(shard: str, entry: Entry | None) -> str | None:
    return None if entry is None else address(shard, entry.place, entry.size, entry.name)
