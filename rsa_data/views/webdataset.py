"""A part of an export as a WebDataset shard: a tar with a few members an image."""

import io
import json
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

_LISTS = ("embedding", "relative", "metric")
_PER_CAPTION = ("variant", "text", "embedding")


def write(rows: pa.Table, path: Path) -> int:
    """Writes the rows of `export_rows.rows` as a tar and returns how many images it holds.

    Members of an image, KEY being its sample_id with / as _: KEY.json (sample_id, captions, scene,
    image, camera, fits), KEY.embedding.npy (captions, dim), KEY.relative.npy and KEY.metric.npy
    float16 (k,) or (height, width), and the picture with its own suffix. The same rows give the
    same bytes.
    """
    count = 0
    with tarfile.open(path, "w", format=tarfile.PAX_FORMAT) as tar:
        for group in _images(rows):
            count += 1
            first = group[0]
            key = str(first["sample_id"]).replace("/", "_").replace(".", "_")
            kept = {k: v for k, v in first.items() if k not in (*_LISTS, "picture", *_PER_CAPTION)}
            if "text" in first:
                kept["captions"] = [row["text"] for row in group]
            text = json.dumps(kept, ensure_ascii=False, sort_keys=True)
            _add(tar, f"{key}.json", text.encode())
            features = np.array([row["embedding"] for row in group], _dtype(rows))
            _add(tar, f"{key}.embedding.npy", _npy(features))
            for name in ("relative", "metric"):
                if first.get(name) is not None:
                    values = np.array(first[name], np.float16)
                    if first["map_height"] is not None:
                        values = values.reshape(first["map_height"], first["map_width"])
                    _add(tar, f"{key}.{name}.npy", _npy(values))
            if "picture" in first:
                suffix = Path(first["picture"]["path"]).suffix.lower() or ".img"
                _add(tar, f"{key}{suffix}", first["picture"]["bytes"])
    return count


def _images(rows: pa.Table) -> Iterator[list[dict[str, Any]]]:
    """The rows of one image after another; they stand together."""
    group: list[dict[str, Any]] = []
    for batch in rows.to_batches(max_chunksize=256):
        for row in batch.to_pylist():
            if group and group[0]["sample_id"] != row["sample_id"]:
                yield group
                group = []
            group.append(row)
    if group:
        yield group


def _dtype(rows: pa.Table) -> Any:
    return rows.schema.field("embedding").type.value_type.to_pandas_dtype()


def _npy(values: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


def _add(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    member = tarfile.TarInfo(name)
    member.size = len(data)
    tar.addfile(member, io.BytesIO(data))
