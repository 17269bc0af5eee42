"""Images in a column of Parquet files, as every data set on the Hugging Face hub has them."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa

from ..common.errors import RsaDataError
from ..common.forms import is_path
from ..common.ranges import PositiveAmount
from . import parquet_rows
from .cameras import UNKNOWN, from_numbers
from .dataset import Dataset, Shards
from .folder import scene as scene_of
from .listing import Sample, stem
from .shard_file import Shard
from .shard_listing import find_shards, index_of, shard_table, split_of
from .shards import address
from .webdataset import shard_depth


@dataclass(frozen=True)
class Columns:
    """The columns that a sample is made of; None: none, or by default."""

    image: str
    depth: str | None
    scene: str | None
    split: str | None
    id: str | None
    intrinsics: str | None
    keys: str


def parquet(
    *,
    image: str = "image",
    depth: str | None = None,
    depth_unit: str | None = None,
    scene: str | None = None,
    split: str | None = None,
    id: str | None = None,
    intrinsics: str | None = None,
    keys: Literal["path", "row"] = "path",
    file_list: Path | None = None,
    min_depth: PositiveAmount = 1e-3,
    max_depth: PositiveAmount = 80.0,
) -> Dataset:
    """Parquet files with images in a column, as on the Hugging Face hub; a part is a file.

    Parameters
    ----------
    image : column with the images: struct of bytes and path, the bytes alone, or paths below the
        root.
    depth : column with depth in the same form: 16-bit PNG, TIFF or .npy.
    depth_unit : unit of the depth files: m, cm, mm, or m/N for N steps a metre (m/256, m/5000).
    scene : column that names the scene. Without it, the folder of the sample's id.
    split : column that names the split. Without it, a file is of the split that its folder or the
        start of its name says (test-00000-of-00001.parquet), else train.
    id : column that names the sample. Without it, the path beside the image's bytes without its
        ending, or the file's name and the row's number where there is none, or one that is no
        path of this dataset (an address, or a file of the machine that wrote it).
    intrinsics : column with fx, fy, cx, cy or the 3 x 3 camera matrix, px.
    keys : path: without `id` a sample has the name of its image's path. row: it has the file's name
        and the row's number, where paths repeat.
    file_list : file with the paths of the Parquet files to take, below the root, one a line.
    min_depth : m, smaller depth counts as none.
    max_depth : m, larger depth counts as none.
    """
    columns = Columns(image, depth, scene, split, id, intrinsics, keys)
    find = partial(find_shards, "parquet", suffix=".parquet", listed=file_list)
    shards = Shards(find, partial(_read, columns))
    return Dataset(
        name="parquet",
        index=partial(index_of, "parquet", shards),
        read_depth=shard_depth("parquet", depth, depth_unit, (min_depth, max_depth)),
        min_depth=min_depth,
        max_depth=max_depth,
        scene=scene_of,
        shards=shards,
    )


def _read(columns: Columns, root: Path, file: str) -> pa.Table:
    return shard_table("parquet", root, _samples(root, columns, file))


def _samples(root: Path, columns: Columns, file: str) -> Iterator[Sample]:
    shard = Shard(root / file)
    schema = parquet_rows.open_file(shard).schema_arrow
    images = _picture(schema, columns.image, file)
    depths = _picture(schema, columns.depth, file) if columns.depth else None
    plain = [columns.scene, columns.split, columns.id, columns.intrinsics]
    named = [name for name in plain if name]
    for name in named:
        _field(schema, name, file)
    wanted = [*named, *(p.read for p in (images, depths) if p is not None and p.read)]
    for group, row, values in parquet_rows.rows(shard, wanted):
        where = f"parquet: {file} row group {group} row {row}"
        path = images.path(values)
        key = f"{stem(file)}/{group:04d}-{row:06d}"
        if columns.id:
            key = _text(values, columns.id, where)
            if not is_path(key) or key.startswith("/") or ".." in key.split("/"):
                raise RsaDataError(f"{where}: expected a sample's name, found {key!r:.60}")
        elif path and not images.inside and ("://" in path or path.startswith("/")):
            raise RsaDataError(
                f"{where}: {columns.image}: expected the path of an image below the root, found "
                f"{path!r:.60}; images as addresses or as text (base64) are not read"
            )
        elif path and columns.keys == "path" and (not images.inside or _plain(path)):
            key = stem(path)
            if not is_path(key) or ".." in key.split("/"):
                raise RsaDataError(f"{where}: expected a sample's name, found {key!r:.60}")
        camera = UNKNOWN
        if columns.intrinsics and values[columns.intrinsics] is not None:
            camera = from_numbers(values[columns.intrinsics], f"{where}: {columns.intrinsics}")
        yield Sample(
            split=_text(values, columns.split, where) if columns.split else split_of(file),
            key=key,
            scene=_text(values, columns.scene, where) if columns.scene else scene_of(key),
            image=images.place(file, group, row, values, key),
            depth=depths.place(file, group, row, values, key) if depths else None,
            camera=camera,
        )


@dataclass(frozen=True)
class _Picture:
    """A column with pictures. read : what of it the index reads: paths, never bytes."""

    column: str
    read: str | None
    inside: bool

    def path(self, values: dict[str, Any]) -> str | None:
        """The path that stands in a row, if there is one."""
        value = values.get(self.column) if self.read else None
        found = value.get("path") if isinstance(value, dict) else value
        return found if isinstance(found, str) and found else None

    def place(
        self, file: str, group: int, row: int, values: dict[str, Any], key: str
    ) -> str | None:
        """Where the picture of a row is, for samples; key : its name where it has no path."""
        path = self.path(values)
        if not self.inside:
            return path
        if self.read and values.get(self.column) is None:
            return None
        return address(file, group, row, f"{self.column}/{path or key}")


def _picture(schema: pa.Schema, name: str, file: str) -> _Picture:
    kind = _field(schema, name, file).type
    if pa.types.is_struct(kind):
        fields = {kind.field(i).name for i in range(kind.num_fields)}
        if "bytes" in fields:
            return _Picture(name, f"{name}.path" if "path" in fields else None, True)
    if pa.types.is_binary(kind) or pa.types.is_large_binary(kind):
        return _Picture(name, None, True)
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return _Picture(name, name, False)
    raise RsaDataError(
        f"parquet: {file}: column {name}: expected images as struct<bytes, path>, bytes or paths, "
        f"found {kind}"
    )


def _plain(path: str) -> bool:
    """Whether a text beside an image's bytes is a path of this dataset, by which it is known."""
    parts = path.split("/")
    return is_path(path) and not (set("\\?") & set(path) or {"", ".."} & set(parts))


def _field(schema: pa.Schema, name: str, file: str) -> pa.Field:
    if "/" in name or name not in schema.names:
        raise RsaDataError(
            f"parquet: {file}: expected the column {name}, found {', '.join(schema.names)}. Name "
            "another by --dataset-option, or the files that have it by file_list"
        )
    return schema.field(name)


def _text(values: dict[str, Any], column: str, where: str) -> str:
    value = values[column]
    if not isinstance(value, (str, int)) or not str(value):
        raise RsaDataError(f"{where}: {column}: expected a name, found {value!r:.60}")
    return str(value)
