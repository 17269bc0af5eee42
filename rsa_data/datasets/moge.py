"""The benchmarks that MoGe's authors prepared: zips of folders, one for each image, on the hub."""

import math
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa

from ..common import bounded
from ..common.errors import RowError, RsaDataError
from ..common.ranges import PositiveAmount
from . import hub_copies, zip_members
from .cameras import UNKNOWN, Camera, from_numbers
from .dataset import Dataset, Shards
from .images import image_size
from .listing import Sample, inside
from .pixel_files import GREY, read_png
from .shard_file import Shard
from .shard_listing import index_of, shard_table
from .shard_records import read_json
from .shards import address, located
from .tar_members import Entry

# Those whose depth is in metres; GSO, Sintel and Spring have no scale.
Benchmark = Literal["NYUv2", "KITTI", "ETH3D", "iBims-1", "DDAD", "DIODE", "HAMMER"]

_STEPS = 65533


def moge(
    *,
    benchmark: Benchmark = "NYUv2",
    min_depth: PositiveAmount = 1e-3,
    max_depth: PositiveAmount | None = None,
) -> Dataset:
    """NYUv2, KITTI, ETH3D, iBims-1, DDAD, DIODE, HAMMER as MoGe's test sets, from the hub.

    Parameters
    ----------
    benchmark : which of the zips; all its images are test images.
    min_depth : m, smaller depth counts as none.
    max_depth : m, larger depth counts as none; by default what is usual for the benchmark.
    """
    about = hub_copies.about("moge")
    shards = Shards(lambda root: [f"{benchmark}.zip"], _read)
    return Dataset(
        name="moge",
        index=partial(index_of, "moge", shards),
        read_depth=read_depth,
        min_depth=min_depth,
        max_depth=max_depth or about["max_depth"][benchmark],
        scene=_scene,
        shards=shards,
        address=about["address"],
    )


def read_depth(path: Path) -> np.ndarray:
    """A depth.png of these zips: path -> float32 (height, width), m, 0 where there is none.

    The values 1 to 65534 are equal steps of log depth between `near` and `far`, which stand in the
    file's text chunks; 0 is unknown and 65535 infinite (MoGe, moge/utils/io.py). Raises RowError
    for a file that is missing, broken or of another kind.
    """
    png = read_png(path, "depth: a 16-bit grey PNG with near and far")
    if (png.bits, png.colour) != (16, GREY):
        raise RowError(f"depth: expected a 16-bit grey PNG, found {png.described()}")
    near, far = (_metres(png.text, key) for key in ("near", "far"))
    if far <= near or png.text.get("unit") not in (None, "1", "1.0"):
        raise RowError(f"depth: expected near below far, in metres, found {dict(png.text)}")
    share = (png.values.astype(np.float32) - 1) / _STEPS
    depth = np.exp(math.log(near) * (1 - share) + math.log(far) * share).astype(np.float32)
    depth[(png.values == 0) | (png.values > _STEPS + 1)] = 0
    return depth


def _metres(text: Mapping[str, str], key: str) -> float:
    try:
        value = float(text.get(key, ""))
    except ValueError:
        value = 0.0
    if not 0 < value < math.inf:
        raise RowError(f"depth: expected a text chunk {key} above 0, found {text.get(key)!r:.40}")
    return value


def _scene(key: str) -> str:
    return key.rpartition("/")[0] or "."


def _read(root: Path, shard: str) -> pa.Table:
    return shard_table("moge", root, _samples(root, shard))


def _samples(root: Path, shard: str) -> Iterator[Sample]:
    """In the order of .index.txt, where the zip has one, else in that of the zip."""
    folders: dict[str, dict[str, Entry]] = {}
    for entry in zip_members.entries(Shard(root / shard)):
        above, _, name = inside(entry.name, f"moge: {shard}").rpartition("/")
        folders.setdefault(above, {})[name] = entry
    tops = [folder for folder, files in folders.items() if ".index.txt" in files]
    if len(tops) > 1:
        raise RsaDataError(f"moge: {shard}: expected one .index.txt, found {len(tops)}")
    top = tops[0] if tops else shard.removesuffix(".zip")
    if tops:
        listed = folders[top][".index.txt"]
        place = address(shard, listed.place, listed.size, listed.name)
        lines = bounded.read(located(root / place), "record").decode("utf-8", "replace")
        keys = [line.strip() for line in lines.splitlines() if line.strip()]
    else:
        found = (f for f, files in folders.items() if "image.jpg" in files)
        keys = [folder.removeprefix(f"{top}/") for folder in found]
    for key in keys:
        files = folders.get(f"{top}/{key}", folders.get(key, {}))
        image, depth = (_address(shard, files.get(n)) for n in ("image.jpg", "depth.png"))
        camera, size = _camera(root, shard, key, image, files)
        yield Sample("test", inside(key, f"moge: {shard}"), _scene(key), image, depth, camera, size)


def _camera(
    root: Path, shard: str, key: str, image: str | None, files: dict[str, Entry]
) -> tuple[Camera, tuple[int | None, int | None]]:
    """Intrinsics in px, and width and height: meta.json has them as shares of these."""
    if image is None or "meta.json" not in files:
        return UNKNOWN, (None, None)
    where = f"moge: {shard}: {key}/meta.json"
    try:
        width, height = image_size(root / image)
    except RowError:
        return UNKNOWN, (None, None)  # the stage that reads it says why
    shares = read_json(root, shard, files["meta.json"], where).get("intrinsics")
    fx, fy, cx, cy = from_numbers(shares, where)
    assert fx is not None and fy is not None and cx is not None and cy is not None
    return (fx * width, fy * height, cx * width, cy * height), (width, height)


def _address(shard: str, entry: Entry | None) -> str | None:
    return None if entry is None else address(shard, entry.place, entry.size, entry.name)
