"""The captions table from its columns, and the key of each text."""

import hashlib
from collections.abc import Mapping

import numpy as np
import pyarrow as pa

from .. import tables


def caption_table(
    sample_id: pa.ChunkedArray,
    rows: np.ndarray,
    variant: np.ndarray,
    text: pa.Array,
    columns: Mapping[str, np.ndarray],
    metadata: Mapping[str, str],
) -> pa.Table:
    """A captions table.

    rows, variant : integer arrays of shape (n,), for each text the row of its sample in
        `sample_id` and its number there. columns : the other columns. metadata : how the texts
        were made, kept with the field text.
    """
    schema = tables.schema("captions")
    fixed = {
        "sample_id": sample_id.combine_chunks().take(pa.array(rows)),
        "variant": pa.array(variant, pa.int16()),
        "text": (schema.field("text").with_metadata(dict(metadata)), text),
        "text_id": text_ids(text),
    }
    numbers = {n: pa.array(c).cast(schema.field(n).type, safe=False) for n, c in columns.items()}
    return tables.from_columns("captions", {**fixed, **numbers})


def text_ids(text: pa.Array) -> pa.Array:
    """BLAKE2b of 16 bytes of each text's UTF-8: the key that embeddings have."""
    blake2b = hashlib.blake2b
    digests = [blake2b(t, digest_size=16).digest() for t in text.cast(pa.binary()).to_pylist()]
    return pa.Array.from_buffers(pa.binary(16), len(text), [None, pa.py_buffer(b"".join(digests))])
