"""From chosen objects to texts: bytes are gathered once, straight into the column."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ..common.errors import RsaDataError
from .choose import Chosen

# A string column addresses its bytes with int32.
MAX_BYTES = 2**31 - 1


@dataclass(frozen=True)
class Column:
    """One piece of every object's phrase: a table of strings and each object's place in it.

    strings : the distinct strings.
    codes : integer array of shape (objects,), or None where all have the first string.
    """

    strings: Sequence[str]
    codes: np.ndarray | None = None


def texts(
    chosen: Chosen,
    phrase: Sequence[Column],
    opening: Column,
    between: str,
    last: str,
    closing: str,
    nothing: str,
) -> pa.Array:
    """The text of each caption: opening, phrases with signs between them, closing.

    chosen : the objects of each caption.
    phrase : the columns whose strings, side by side, are an object's phrase.
    opening : what stands before the first object; codes by object.
    between, last : the sign between two phrases, and before the last one of several.
    closing : what stands after the last phrase.
    nothing : the whole text of a caption without objects.
    Raises RsaDataError when the texts are too long for one column.
    """
    caption, objects = chosen.caption, chosen.object
    edge = np.flatnonzero(caption[1:] != caption[:-1])
    begins, ends = np.append(0, edge + 1)[: len(caption)], np.append(edge, len(caption) - 1)
    is_first = np.zeros(len(caption), bool)
    is_first[begins] = True
    version = is_first.astype(np.int8)
    if last != between or closing:
        version[ends[: len(begins)]] += 2
    leads: dict[int, Column | str] = {0: between, 1: opening, 2: last, 3: opening}
    values, index = [pa.array([nothing])], np.zeros(len(caption), np.int64)
    known, size = objects >= 0, 1
    place = np.empty(int(objects.max()) + 1, np.int64)
    for number, lead in leads.items():
        entries = np.flatnonzero((version == number) & known)
        # Only what some caption uses is spelled out.
        used = np.zeros(len(place), bool)
        used[objects[entries]] = True
        rows = np.flatnonzero(used)
        place[rows] = np.arange(size, size + len(rows))
        index[entries] = place[objects[entries]]
        size += len(rows)
        if len(rows):
            values.append(_spell([lead, *phrase, closing if number >= 2 else ""], rows))
    return _gather(pa.concat_arrays(values), index, begins)


def _spell(pieces: Sequence[Column | str], rows: np.ndarray) -> pa.Array:
    parts: list[pa.Array | str] = []
    for piece in pieces:
        if isinstance(piece, str):
            parts.append(piece)
        elif piece.codes is None:
            parts.append(piece.strings[0])
        else:
            parts.append(pa.array(piece.strings, pa.string()).take(pa.array(piece.codes[rows])))
    if all(isinstance(part, str) for part in parts):
        return pa.array(["".join(parts)] * len(rows), pa.string())
    return pc.binary_join_element_wise(*parts, "")


def _gather(values: pa.Array, index: np.ndarray, begins: np.ndarray) -> pa.Array:
    """Strings values[index], those from one of `begins` up to the next as one string."""
    lengths = pc.binary_length(values).to_numpy()
    size = int(lengths[index].sum(dtype=np.int64))
    if size > MAX_BYTES:
        raise RsaDataError(
            f"captions: {len(begins)} texts are {size / 2**30:.1f} GB, expected at most 2 GB in a "
            "part. Give fewer --variants, a smaller --max-tokens, or index into smaller parts"
        )
    taken = values.take(pa.array(index))
    _, offsets, data = taken.buffers()
    ends = np.frombuffer(offsets, np.int32, len(taken) + 1)
    # A gathered array without its inner offsets is the concatenation: no byte moves twice.
    joined = pa.py_buffer(np.append(ends[begins], ends[-1]).astype(np.int32))
    return pa.Array.from_buffers(pa.string(), len(begins), [None, joined, data])
