"""Whether an ONNX model keeps weights in other files, found without the onnx package.

Such a file could lie anywhere the model names, and its bytes are in no checksum and no fingerprint.
Only the fields that lead to tensors are walked; numbers are those of onnx.proto3.
"""

import mmap
from collections.abc import Iterator
from pathlib import Path

from .errors import RsaDataError

# Message -> {field number: message it holds}.
_FIELDS = {
    "model": {7: "graph", 25: "function"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "function": {7: "node"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
    "tensor": {},
}
_EXTERNAL_DATA, _DATA_LOCATION, _EXTERNAL = 13, 14, 1
_DEEPEST = 50


def refuse(path: Path) -> None:
    """Raises RsaDataError when a tensor of the model lies in another file.

    A file that is no ONNX model is left to who opens it.
    """
    with path.open("rb") as file:
        if not path.stat().st_size:
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            try:
                found = _external(data, 0, len(data), "model", 0)
            except (IndexError, ValueError):
                return
    if found:
        raise RsaDataError(
            f"{path}: expected an ONNX model in one file; this one has weights in other files, "
            "which no checksum covers. Put them into it: onnx.save(onnx.load(FILE), OTHER)"
        )


def _external(data: mmap.mmap, start: int, end: int, kind: str, depth: int) -> bool:
    if depth > _DEEPEST:
        raise ValueError("nested too deep")
    for number, value, first, last in _fields(data, start, end):
        if kind == "tensor" and (
            number == _EXTERNAL_DATA or (number == _DATA_LOCATION and value == _EXTERNAL)
        ):
            return True
        inner = _FIELDS[kind].get(number)
        if inner and last and _external(data, first, last, inner, depth + 1):
            return True
    return False


def _fields(data: mmap.mmap, at: int, end: int) -> Iterator[tuple[int, int, int, int]]:
    """(field number, value of a varint, start and end of what has a length) of a message."""
    while at < end:
        key, at = _varint(data, at)
        kind, number = key & 7, key >> 3
        if kind == 0:
            value, at = _varint(data, at)
            yield number, value, 0, 0
        elif kind == 2:
            length, at = _varint(data, at)
            if at + length > end:
                raise ValueError("a field is longer than its message")
            yield number, 0, at, at + length
            at += length
        elif kind in (1, 5):
            at += 8 if kind == 1 else 4
        else:
            raise ValueError("no protobuf")


def _varint(data: mmap.mmap, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
        shift += 7
        if shift > 63:
            raise ValueError("no protobuf")
