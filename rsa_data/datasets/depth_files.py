"""Reading ground-truth depth: 16-bit PNG in any unit, TIFF, NumPy arrays."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..common.errors import RowError, UsageError
from ..common.numbers import real
from .images import read_bytes
from .pixel_files import GREY, float32, read_npy, read_png, read_tiff

# Units in a metre.
UNITS = {"m": 1.0, "cm": 100.0, "mm": 1000.0}


def units_per_metre(text: str) -> float:
    """How many of a unit make a metre: m, cm, mm, or m/N (KITTI and VOID m/256, TUM m/5000).

    Raises ValueError for anything else.
    """
    if text in UNITS:
        return UNITS[text]
    per_metre = real(text.removeprefix("m/")) if text.startswith("m/") else 0.0
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
        try:
            values = read_png16(path)
        except RowError as error:
            raise RowError(f"depth: {error}") from error
        if rotated:
            values = values >> rotated | values << (16 - rotated)
        depth = values.astype(np.float32) / np.float32(per_metre)
        depth[np.isin(values, none)] = 0
        return depth

    return read


def any_file(unit: str, option: str) -> Callable[[Path], np.ndarray]:
    """A reader of 16-bit PNG, TIFF or .npy in a stated unit, told apart by their content.

    option : what to name in the UsageError for a unit that there is not.
    """
    try:
        per_metre = units_per_metre(unit)
    except ValueError as error:
        raise UsageError(
            f"{option}: expected {', '.join(UNITS)} or m/N, N steps a metre, found {unit!r}"
        ) from error
    # A camera writes the largest value for "too far".
    read_grey = png16(per_metre, none=(0, 65535))
    read_array = npy(per_metre, none=(65535,), steps=unit not in UNITS)
    read_image = npy(per_metre, none=(65535,), steps=unit not in UNITS, open_file=read_tiff)

    def read(path: Path) -> np.ndarray:
        kind = _kind(path)
        return {"npy": read_array, "tiff": read_image}.get(kind, read_grey)(path)

    return read


def _kind(path: Path) -> str:
    """By the name's ending; where the column of a Parquet file gives none, by the first bytes."""
    suffix = path.suffix.lower()
    if suffix in (".npy", ".png"):
        return suffix[1:]
    try:
        data = read_bytes(path)
    except RowError:
        return ""  # said by the reader
    if data.startswith(b"\x93NUMPY"):
        return "npy"
    return "tiff" if data.startswith((b"II*\0", b"MM\0*")) else "png"


def read_png16(path: Path) -> np.ndarray:
    """The values of a 16-bit grey PNG: uint16 of shape (height, width). Raises RowError."""
    png = read_png(path, "a 16-bit grey PNG")
    if (png.bits, png.colour) != (16, GREY):
        raise RowError(f"expected a 16-bit grey PNG, found {png.described()}")
    return png.values


def npy(
    per_metre: float,
    none: tuple[int, ...] = (),
    steps: bool = False,
    open_file: Callable[[Path], np.ndarray] = read_npy,
) -> Callable[[Path], np.ndarray]:
    """A reader of .npy depth: path -> float32 of shape (height, width), m, 0 where there is none.

    The file holds one array of shape (height, width), integer or real, maybe with axes of size 1
    more. Values that are not finite or not above 0 mean none, and so does the largest value of the
    array's integer type.

    per_metre : units of the file in a metre, 1 for metres.
    none : values of integers that mean none besides.
    steps : whether the unit is so many steps a metre, which only integers are counted in.
    open_file : path -> the numbers, for files of another kind.

    The reader raises RowError for a file that is missing, broken or of another kind.
    """

    def read(path: Path) -> np.ndarray:
        try:
            values = open_file(path)
        except RowError as error:
            raise RowError(f"depth: {error}") from error
        if steps and values.dtype.kind == "f":
            raise RowError(
                f"depth: expected integers, counted in steps of 1/{per_metre:g} m, found "
                f"{values.dtype}; if the file is in metres, say depth_unit=m"
            )
        with np.errstate(invalid="ignore"):  # a signalling NaN, which means none like any other
            depth = float32(values) / np.float32(per_metre)
        depth[~(np.isfinite(depth) & (depth > 0))] = 0
        if values.dtype.kind in "iu":
            depth[np.isin(values, [*none, np.iinfo(values.dtype).max])] = 0
        return depth

    return read
