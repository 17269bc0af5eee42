"""Parquet shards with images in a column: rows without their bytes, and the bytes of one row."""

import threading
from collections import OrderedDict
from collections.abc import Iterator

import pyarrow as pa
import pyarrow.parquet as pq

from ..common.errors import RowError, RsaDataError, TransientError
from .shard_file import Shard, instead

# Columns of a row group that are kept: those that the readers of a part are in.
_KEPT = 3
# Rows that are Python's objects at one time.
_ROWS = 4096
_lock = threading.Lock()
_columns: OrderedDict[tuple[str, int, int, str], pa.ChunkedArray] = OrderedDict()


def open_file(shard: Shard) -> pq.ParquetFile:
    """The Parquet file of a shard; raises RsaDataError when it is none."""
    try:
        return pq.ParquetFile(pa.PythonFile(shard.file(), mode="r"))
    except (pa.ArrowException, OSError) as error:
        raise RsaDataError(
            f"{shard.path}: expected a Parquet file, found: {instead(shard, error)}"
        ) from error


def rows(shard: Shard, columns: list[str]) -> Iterator[tuple[int, int, dict[str, object]]]:
    """(row group, row in it, values) of every row; columns may name fields, as image.path."""
    file = open_file(shard)
    for group in range(file.num_row_groups):
        count = file.metadata.row_group(group).num_rows
        if not columns:
            yield from ((group, row, {}) for row in range(count))
            continue
        row = 0
        try:
            for batch in file.iter_batches(_ROWS, [group], columns, use_threads=False):
                for values in batch.to_pylist():
                    yield group, row, values
                    row += 1
        except (pa.ArrowException, OSError) as error:
            raise RsaDataError(f"{shard.path}: row group {group}: {error}") from error


def read(shard: Shard, group: int, row: int, name: str) -> bytes:
    """The bytes of a row; name : COLUMN/NAME, of which the image's name is for people.

    Raises RowError where the file has no such row or the row no bytes.
    """
    column = _column(shard, group, name.partition("/")[0])
    if row >= len(column):
        raise RowError(f"expected row {row} of row group {group} in {shard.path.name}, found none")
    value = column[row].as_py()
    if isinstance(value, dict):
        if value.get("bytes") is None and value.get("path"):
            raise RowError(f"expected the image's bytes, found a path alone: {value['path']}")
        value = value.get("bytes")
    if not isinstance(value, bytes):
        raise RowError("expected the image's bytes, found none")
    return value


def texts(shard: Shard, group: int, row: int, name: str) -> list[str]:
    """The texts in a column of a row: one, those of a list, or none for null.

    Raises RowError where the file has no such column, RsaDataError where it holds no texts.
    """
    column = _column(shard, group, name)
    value = column[row].as_py()
    found = value if isinstance(value, list) else [] if value is None else [value]
    if not all(isinstance(text, str) for text in found):
        raise RsaDataError(
            f"{shard.path}: column {name}: expected texts or lists of them, found {column.type}"
        )
    return found


def _column(shard: Shard, group: int, name: str) -> pa.ChunkedArray:
    key = (str(shard.path), shard.size, group, name)
    with _lock:  # whoever comes second waits for the first instead of reading the same again
        if key not in _columns:
            try:
                file = open_file(shard)
                if group >= file.num_row_groups or name not in file.schema_arrow.names:
                    raise RowError(
                        f"expected column {name} in row group {group} of {shard.path.name}, found "
                        "none"
                    )
                table = file.read_row_group(group, columns=[name], use_threads=False)
            except pa.ArrowException as error:
                raise RowError(f"unreadable row group {group}: {error}") from error
            except OSError as error:
                raise TransientError(f"{shard.path}: {error}; the part can be run again") from error
            except RsaDataError as error:
                raise (
                    error if isinstance(error, (RowError, TransientError)) else RowError(str(error))
                ) from error
            _columns[key] = table[name]
            while len(_columns) > _KEPT:
                _columns.popitem(last=False)
        _columns.move_to_end(key)
        return _columns[key]
