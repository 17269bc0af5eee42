"""The captions table from its columns, and the key of each text."""

import hashlib
from collections.abc import Mapping

import numpy as np
import pyarrow as pa

from ..store import schemas

# Columns that say which caption a row is; all others but text_id are measured of its text.
_WHICH = ("sample_id", "variant")

# By name; a text is an Arrow array, numbers are NumPy arrays.
Columns = dict[str, pa.Array | np.ndarray]


def measured() -> list[str]:
    """Names of the columns that `compose` makes, in the order of the schema."""
    return [n for n in schemas.schema("captions").names if n not in (*_WHICH, "text_id")]


def of_objects() -> list[str]:
    """Those of them that count objects or sum their shares: 0 for a text that was imported."""
    return [name for name in measured() if name not in ("text", "n_tokens")]


def caption_table(columns: Columns, metadata: Mapping[str, str]) -> pa.Table:
    """A captions table from all its columns but text_id.

    metadata : how the texts were made, kept with the field text.
    """
    schema = schemas.schema("captions")
    made = {"text_id": text_ids(columns["text"])}
    for name, column in columns.items():
        if isinstance(column, np.ndarray):
            made[name] = pa.array(column).cast(schema.field(name).type, safe=False)
        else:
            made[name] = column
    text = schema.field("text").with_metadata(dict(metadata)), made.pop("text")
    return schemas.from_columns("captions", {**made, "text": text})


def text_ids(text: pa.Array) -> pa.Array:
    """BLAKE2b of 16 bytes of each text's UTF-8: the key that embeddings have."""
    blake2b = hashlib.blake2b
    digests = [blake2b(t, digest_size=16).digest() for t in text.cast(pa.binary()).to_pylist()]
    return pa.Array.from_buffers(pa.binary(16), len(text), [None, pa.py_buffer(b"".join(digests))])
