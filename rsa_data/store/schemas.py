"""schemas/*.toml -> Arrow schemas, and the checks that every table passes before it is written."""

import hashlib
import re
import tomllib
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ..common.errors import RsaDataError
from ..common.files import shipped


@cache
def definition(name: str) -> dict[str, Any]:
    """schemas/NAME.toml as it stands: version, key, doc, columns."""
    there = {path.stem: path for path in shipped("schemas").glob("*.toml")}
    if name not in there:
        raise RsaDataError(f"expected a schema among {', '.join(sorted(there))}, found {name!r}")
    return tomllib.loads(there[name].read_text("utf-8"))


def check_version(name: str, version: int, where: str) -> None:
    """Raises RsaDataError for a version of a schema that is not known here."""
    known = definition(name)["version"]
    if not 1 <= version <= known:
        raise RsaDataError(
            f"{where}: expected version {known} of the schema {name}, or an earlier one; found "
            f"{version}. Read it with the version of rsa-data that wrote it"
        )


def arrow_type(text: str) -> pa.DataType:
    """An Arrow type from its notation in schemas/: string, list<T>, T[n], binary[16], binary[*].

    `binary[*]` is a fixed-size binary whose width each table states in its field's metadata; it
    is returned as plain binary here.
    """
    if match := re.fullmatch(r"list<(.+)>", text):
        return pa.list_(arrow_type(match[1]))
    if text == "binary[*]":
        return pa.binary()
    if match := re.fullmatch(r"binary\[(\d+)\]", text):
        return pa.binary(int(match[1]))
    if match := re.fullmatch(r"(.+)\[(\d+)\]", text):
        return pa.list_(arrow_type(match[1]), int(match[2]))
    return pa.type_for_alias(text)


@cache
def schema(name: str) -> pa.Schema:
    """The Arrow schema of a table, nullability included."""
    columns = definition(name)["columns"]
    return pa.schema(
        pa.field(column, arrow_type(spec["type"]), nullable=spec.get("nullable", False))
        for column, spec in columns.items()
    )


def from_columns(name: str, columns: Mapping[str, Any]) -> pa.Table:
    """A table of schema `name` from columns, each column named exactly once.

    A column is a list, an Arrow array, or the (field, array) of `embedding_column`.
    """
    expected = schema(name)
    if set(columns) != set(expected.names):
        raise RsaDataError(
            f"{name}: expected the columns {', '.join(expected.names)}; found {', '.join(columns)}"
        )
    arrays, fields = [], []
    for field in expected:
        given = columns[field.name]
        if isinstance(given, tuple):
            field, given = given
        elif not isinstance(given, (pa.Array, pa.ChunkedArray)):
            given = pa.array(given, field.type)
        arrays.append(given)
        fields.append(field)
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))


def check(name: str, table: pa.Table) -> None:
    """Raises RsaDataError unless `table` is exactly as schemas/NAME.toml says.

    That is: its columns in their order, their types, values and nulls.

    `pa.Table.from_pylist` with a schema lets nulls into fields declared non-null and drops unknown
    keys, so nothing is written without this.
    """
    spec = definition(name)["columns"]
    if table.column_names != list(spec):
        raise RsaDataError(
            f"{name}: expected the columns {', '.join(spec)}; found {', '.join(table.column_names)}"
        )
    for column, want in spec.items():
        field, data = table.schema.field(column), table[column]
        if want["type"] == "binary[*]":
            if not pa.types.is_fixed_size_binary(field.type) or not {b"dtype", b"shape"} <= set(
                field.metadata or {}
            ):
                raise RsaDataError(
                    f"{name}.{column}: expected fixed-size binary with dtype and shape in the "
                    f"field's metadata; found {field.type} with {field.metadata}"
                )
        elif field.type != arrow_type(want["type"]):
            raise RsaDataError(f"{name}.{column}: expected type {want['type']}; found {field.type}")
        if data.null_count and not want.get("nullable"):
            row = pc.index(data.is_null(), True).as_py()
            raise RsaDataError(f"{name}.{column}: expected no null; found one in row {row}")
        if pa.types.is_list(field.type) and pc.list_flatten(data).null_count:
            raise RsaDataError(f"{name}.{column}: expected no null inside a list; found one")
        if "values" in want and (
            strange := set(pc.unique(data.drop_null()).to_pylist()) - set(want["values"])
        ):
            raise RsaDataError(
                f"{name}.{column}: expected one of {', '.join(want['values'])}; "
                f"found {', '.join(sorted(strange))}"
            )


def digest(table: pa.Table) -> str:
    """sha256 of a table's logical content: column names, types, field metadata and values.

    Independent of chunking, slicing, Parquet encoding and library versions; two tables with the
    same rows in the same order have the same digest.
    """
    sha = hashlib.sha256()
    for field in table.schema:
        metadata = sorted((field.metadata or {}).items())
        metadata = [(k, v) for k, v in metadata if not k.startswith(b"PARQUET:")]
        sha.update(repr((field.name, type_text(field.type), metadata, len(table))).encode())
        column = table[field.name]
        array = column.combine_chunks() if column.num_chunks != 1 else column.chunk(0)
        _digest_array(sha, array)
    return sha.hexdigest()


def type_text(kind: pa.DataType) -> str:
    """A type as schemas/ write it. Arrow's own text names a list's field, which Parquet renames."""
    if pa.types.is_list(kind):
        return f"list<{type_text(kind.value_type)}>"
    if pa.types.is_fixed_size_list(kind):
        return f"{type_text(kind.value_type)}[{kind.list_size}]"
    return str(kind)


def _digest_array(sha: Any, array: pa.Array) -> None:
    sha.update(np.packbits(pc.is_valid(array).to_numpy(zero_copy_only=False)).tobytes())
    kind = array.type
    if pa.types.is_list(kind) or pa.types.is_large_list(kind):
        lengths = pc.fill_null(pc.list_value_length(array), 0)
        sha.update(lengths.cast(pa.int64()).to_numpy(zero_copy_only=False).tobytes())
        _digest_array(sha, array.flatten())
    elif pa.types.is_fixed_size_list(kind):
        _digest_array(sha, array.flatten())
    elif pa.types.is_string(kind) or pa.types.is_binary(kind):
        array = pc.fill_null(array, b"" if pa.types.is_binary(kind) else "")
        lengths = pc.binary_length(array).cast(pa.int64())
        sha.update(lengths.to_numpy(zero_copy_only=False).tobytes())
        _, offsets, data = array.buffers()
        if len(array):
            ends = np.frombuffer(offsets, np.int32, len(array) + 1, array.offset * 4)
            sha.update(memoryview(data)[ends[0] : ends[-1]] if data else b"")
    elif pa.types.is_fixed_size_binary(kind):
        array = array if not array.null_count else pc.fill_null(array, bytes(kind.byte_width))
        start = array.offset * kind.byte_width
        if len(array):
            sha.update(memoryview(array.buffers()[1])[start : start + len(array) * kind.byte_width])
    else:
        zero = pa.scalar(False if pa.types.is_boolean(kind) else 0, kind)
        values = pc.fill_null(array, zero).to_numpy(zero_copy_only=False)
        sha.update(np.ascontiguousarray(values).tobytes())


def embedding_column(features: np.ndarray) -> tuple[pa.Field, pa.Array]:
    """A fixed-size binary column of features and its field, dtype and shape in the metadata.

    features : array of shape (n, dim), float16 or float32. Nothing is cast.
    """
    if features.ndim != 2:
        raise ValueError(f"features: expected shape (n, dim), found {features.shape}")
    little = features.astype(features.dtype.newbyteorder("<"), copy=False)
    data = pa.py_buffer(np.ascontiguousarray(little))
    width = features.shape[1] * features.dtype.itemsize
    array = pa.Array.from_buffers(pa.binary(width), len(features), [None, data])
    metadata = {"dtype": features.dtype.name, "shape": str(features.shape[1])}
    return pa.field("embedding", array.type, nullable=False, metadata=metadata), array


def embedding_array(table: pa.Table, column: str = "embedding") -> np.ndarray:
    """The features of an embeddings table as an array of shape (n, dim) of their stored dtype.

    Zero-copy where the column is one chunk.
    """
    field = table.schema.field(column)
    metadata = field.metadata or {}
    dtype = np.dtype(metadata[b"dtype"].decode()).newbyteorder("<")
    dim = int(metadata[b"shape"])
    chunks = [
        np.frombuffer(
            chunk.buffers()[1], dtype, len(chunk) * dim, chunk.offset * dim * dtype.itemsize
        )
        for chunk in table[column].chunks
        if len(chunk)
    ]
    if not chunks:
        return np.empty((0, dim), dtype)
    return (chunks[0] if len(chunks) == 1 else np.concatenate(chunks)).reshape(-1, dim)
