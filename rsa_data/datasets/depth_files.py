"""Reading ground-truth depth: 16-bit PNG in any unit, NumPy arrays."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..common.errors import RowError
from .images import MAX_PIXELS, read_bytes, reason

# Units in a metre.
UNITS = {"m": 1.0, "cm": 100.0, "mm": 1000.0}


def units_per_metre(text: str) -> float:
    """How many of a unit make a metre: m, cm, mm, or m/N (KITTI and VOID m/256, TUM m/5000).

    Raises ValueError for anything else.
    """
    if text in UNITS:
        return UNITS[text]
    per_metre = float(text.removeprefix("m/")) if text.startswith("m/") else 0.0
    if not 0 < per_metre < float("inf"):
        raise ValueError(text)
    return per_metre


def png16(
    per_metre: float, none: tuple[int, ...] = (0,), rotated: int = 0
) -> Callable[[Path], np.ndarray]:
    """A reader of 16-bit grey PNG: path -> float32 of shape (height, width), m, 0 where none.

    per_metre : units of the file in a metre, 1000 for mm.
    none : values that stand for "no depth here".
    rotated : bits by which the file's values are rotated to the left (SUN3D and SUN RGB-D: 3).

    The reader raises RowError for a file that is missing, broken or of another kind.
    """

    def read(path: Path) -> np.ndarray:
        values = read_png16(path)
        if rotated:
            values = values >> rotated | values << (16 - rotated)
        depth = values.astype(np.float32) / np.float32(per_metre)
        for value in none:
            depth[values == value] = 0
        return depth

    return read


def read_png16(path: Path) -> np.ndarray:
    """The values of a 16-bit grey PNG: uint16 of shape (height, width)."""
    data = read_bytes(path)
    if not data.startswith(b"\x89PNG\r\n\x1a\n"):
        found = f"a file that begins with {data[:16]!r}" if data else "an empty file"
        raise RowError(f"depth: expected a 16-bit grey PNG, found {found}")
    if len(data) < 26:
        raise RowError("depth: expected a 16-bit grey PNG, found a PNG without a header")
    # Where every PNG has width, height, bit depth and colour type (PNG 1.2, section 4.1.1).
    width, height, bits, kind = struct.unpack(">IIBB", data[16:26])
    if (bits, kind) != (16, 0):
        raise RowError(
            f"depth: expected a 16-bit grey PNG, found {bits} bits a channel and colour type {kind}"
        )
    if width * height > MAX_PIXELS:
        raise RowError(f"depth: expected at most {MAX_PIXELS} pixels, found {width} x {height}")
    from PIL.PngImagePlugin import PngImageFile

    try:
        return np.asarray(PngImageFile(io.BytesIO(data))).astype(np.uint16)
    except MemoryError:
        raise
    except Exception as error:  # Pillow's decoders raise nearly every built-in kind
        raise RowError(f"depth: unreadable PNG: {reason(error)}") from error


def npy(per_metre: float) -> Callable[[Path], np.ndarray]:
    """A reader of .npy depth: path -> float32 of shape (height, width), m, 0 where there is none.

    The file holds one array of shape (height, width), integer or real; values that are not finite
    or not above 0 mean none.

    per_metre : units of the file in a metre, 1 for metres.

    The reader raises RowError for a file that is missing, broken or of another kind.
    """

    def read(path: Path) -> np.ndarray:
        data = io.BytesIO(read_bytes(path))
        try:
            values = np.lib.format.read_array(data, allow_pickle=False)
        except (
            Exception
        ) as error:  # a damaged header raises anything from SyntaxError to MemoryError
            raise RowError(f"depth: unreadable .npy: {reason(error)}") from error
        if values.ndim != 2 or values.dtype.kind not in "fiu":
            raise RowError(
                f"depth: expected numbers of shape (height, width), found {values.dtype} of shape "
                f"{values.shape}"
            )
        depth = values.astype(np.float32) / np.float32(per_metre)
        depth[~(np.isfinite(depth) & (depth > 0))] = 0
        return depth

    return read
