"""Files whose pixels are numbers, not colours (depth, label maps, id maps): PNG, TIFF and .npy."""

import io
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from ..common.errors import RowError
from .images import MAX_PIXELS, read_bytes, reason

GREY, RGB, PALETTE, GREY_ALPHA, RGBA = 0, 2, 3, 4, 6


@dataclass(frozen=True)
class Png:
    """A PNG's samples as they are stored.

    values : uint8 or uint16 of shape (height, width), or (height, width, channels) with colours;
        of a palette its indices, of 1, 2 and 4 bits the numbers 0 to 1, 3 and 15.
    bits : bits a sample.
    colour : colour type of the header, as the constants above.
    text : what its text chunks say, by keyword.
    """

    values: np.ndarray
    bits: int
    colour: int
    text: Mapping[str, str]

    def described(self) -> str:
        """The kind in words, such as "8 bits, RGB"."""
        kinds = {GREY: "grey", RGB: "RGB", PALETTE: "palette", GREY_ALPHA: "grey with alpha"}
        return f"{self.bits} bits, {kinds.get(self.colour, 'RGB with alpha')}"


def read_png(path: Path, wanted: str) -> Png:
    """The stored samples of a PNG; colours of 16 bits come with their upper 8 only.

    wanted : what the caller expects, such as "a 16-bit grey PNG", for errors.
    Raises RowError, without the path, for a file that is missing, broken or no PNG.
    """
    from PIL.PngImagePlugin import PngImageFile

    data = read_bytes(path)
    if not data.startswith(b"\x89PNG\r\n\x1a\n"):
        found = f"a file that begins with {data[:16]!r}" if data else "an empty file"
        raise RowError(f"expected {wanted}, found {found}")
    if len(data) < 26:
        raise RowError(f"expected {wanted}, found a PNG without a header")
    # Where every PNG has width, height, bit depth and colour type (PNG 1.2, section 4.1.1).
    width, height, bits, colour = struct.unpack(">IIBB", data[16:26])
    if width * height > MAX_PIXELS:
        raise RowError(f"expected at most {MAX_PIXELS} pixels, found {width} x {height}")
    try:
        image = PngImageFile(io.BytesIO(data))
        values, text = np.asarray(image), {k: str(v) for k, v in image.text.items()}
    except MemoryError:
        raise
    except Exception as error:  # Pillow's decoders raise nearly every built-in kind
        raise RowError(f"unreadable PNG: {reason(error)}") from error
    if bits == 16 and colour == GREY:
        return Png(values.astype(np.uint16), bits, colour, text)
    values = values.astype(np.uint8)
    if colour == GREY and bits in (2, 4):
        values //= 255 // (2**bits - 1)  # Pillow stretches grey to 0 to 255
    return Png(values, bits, colour, text)


def read_tiff(path: Path) -> np.ndarray:
    """The numbers of a grey TIFF of one page, as `datasets` keeps arrays: uint16, int32 or float32.

    Raises RowError, without the path, for a file that is missing, broken or holds anything else.
    """
    from PIL.TiffImagePlugin import TiffImageFile

    try:
        image = TiffImageFile(io.BytesIO(read_bytes(path)))
        if image.width * image.height > MAX_PIXELS:
            raise RowError(
                f"expected at most {MAX_PIXELS} pixels, found {image.width} x {image.height}"
            )
        found = f"mode {image.mode}, {image.n_frames} pages"
        if not image.mode.startswith(("I;16", "I", "F")) or image.n_frames != 1:
            raise RowError(f"expected a TIFF with grey of 16 or 32 bits, found {found}")
        values = np.asarray(image)
    except (MemoryError, RowError):
        raise
    except Exception as error:  # Pillow's decoders raise nearly every built-in kind
        raise RowError(f"unreadable TIFF: {reason(error)}") from error
    return values.astype(values.dtype.newbyteorder("="))


def read_npy(path: Path) -> np.ndarray:
    """An array of numbers of shape (height, width), also where the file has axes of size 1 more.

    Raises RowError, without the path, for a file that is missing, broken or holds anything else.
    """
    data = read_bytes(path)
    try:
        check_header(io.BytesIO(data), len(data))
        values: np.ndarray = np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
    except MemoryError:
        raise
    except Exception as error:  # a damaged header raises anything from SyntaxError to MemoryError
        raise RowError(f"unreadable .npy: {reason(error)}") from error
    squeezed = values
    if values.ndim > 2:
        squeezed = values.reshape([side for side in values.shape if side != 1] or [1])
    if squeezed.ndim != 2 or values.dtype.kind not in "fiu" or not values.size:
        raise RowError(
            f"expected numbers of shape (height, width), found {values.dtype} of shape "
            f"{values.shape}"
        )
    return squeezed


def check_header(file: IO[bytes], size: int) -> None:
    """Raises ValueError when a .npy file of `size` bytes announces more numbers than it holds.

    Memory for them would be taken before the first one is read.
    """
    version = np.lib.format.read_magic(file)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"format {version[0]}.{version[1]}; expected 1.0 or 2.0")
    first = version == (1, 0)
    read = np.lib.format.read_array_header_1_0 if first else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    if math.prod(shape) * dtype.itemsize > size:
        raise ValueError(f"its header announces {shape} of {dtype}, which {size:,} bytes cannot be")


def float32(values: np.ndarray) -> np.ndarray:
    """The values as float32; what it cannot hold becomes inf, without a warning."""
    with np.errstate(over="ignore"):
        return values.astype(np.float32)
