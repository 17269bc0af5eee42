"""One form for everything that is compared: JSON and Parquet whose bytes follow from the values."""

import hashlib
import io
import json
from typing import Any

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq


def to_json(value: Any) -> bytes:
    """JSON with sorted keys, of plain values or structures: the same value gives the same bytes."""
    text = json.dumps(
        value, sort_keys=True, indent=1, ensure_ascii=False, default=msgspec.to_builtins
    )
    return (text + "\n").encode()


def fingerprint(value: Any) -> str:
    """sha256 of a JSON value or a structure."""
    return hashlib.sha256(to_json(value)).hexdigest()


def encoded(table: pa.Table) -> memoryview:
    """A table as the bytes of a Parquet file; the same table gives the same bytes."""
    buffer = io.BytesIO()
    # Dictionary pages and statistics cost time and say nothing for long unique values.
    plain = [
        f.name
        for f in table.schema
        if pa.types.is_fixed_size_binary(f.type) or pa.types.is_binary(f.type)
    ]
    pq.write_table(
        table,
        buffer,
        row_group_size=20_000,
        compression={f.name: "none" if f.name in plain else "zstd" for f in table.schema},
        use_dictionary=[f.name for f in table.schema if f.name not in plain],
        write_statistics=[f.name for f in table.schema if f.name not in plain],
    )
    return buffer.getbuffer()


def differences(old: Any, new: Any, where: str = "") -> list[tuple[str, Any, Any]]:
    """Paths at which two JSON values differ, with both values."""
    if isinstance(old, dict) and isinstance(new, dict):
        return [
            difference
            for key in sorted(old.keys() | new.keys())
            for difference in differences(
                old.get(key), new.get(key), f"{where}.{key}" if where else key
            )
        ]
    return [] if old == new else [(where, old, new)]


def short(value: Any) -> str:
    """A JSON value in a few characters, for messages."""
    text = "nothing" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."
