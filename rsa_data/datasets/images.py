"""Reading images: every kind of file that a folder of photographs holds, as RGB of 8 bits.

Pillow decodes: on the frames this was measured with it is as fast as OpenCV, gives the same pixels,
works in threads, and raises on a truncated file where OpenCV may return what it has.
"""

from __future__ import annotations

import contextlib
import errno
import io
import re
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from ..common import bounded
from ..common.errors import RowError, TransientError
from .roots import RemotePath
from .shards import located

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

_PLAIN = {".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".webp", ".bmp", ".gif", ".tif", ".tiff"}
_AVIF, _HEIC = {".avif"}, {".heic", ".heif"}
SUFFIXES = frozenset(_PLAIN | _AVIF | _HEIC)

# Twice the largest single photograph in use; 300 MB once decoded.
MAX_PIXELS = 100_000_000

# Bytes that hold the header of most files, with the thumbnail that cameras put there.
_HEADER = 1 << 16

# Why a row fails whose file is not there.
MISSING = "no such file"

# How a file begins, and the kind of Pillow's that reads it.
_MAGIC = {
    b"\xff\xd8\xff": "Jpeg",
    b"\x89PNG\r\n\x1a\n": "Png",
    b"RIFF": "WebP",
    b"BM": "Bmp",
    b"GIF8": "Gif",
    b"II*\0": "Tiff",
    b"MM\0*": "Tiff",
}

_KINDS = "a JPEG, PNG, WebP, BMP, GIF or TIFF image"


@cache
def readable() -> frozenset[str]:
    """The endings of images that this Python can read: AVIF and HEIC where Pillow knows them."""
    from PIL import features

    found = _PLAIN | (_AVIF if features.check("avif") else set())
    return frozenset(found | (_HEIC if find_spec("pillow_heif") else set()))


def read_image(path: Path, max_pixels: int = MAX_PIXELS) -> np.ndarray:
    """The image as it is meant to be seen: uint8 of shape (height, width, 3), RGB, 0 to 255.

    EXIF rotation is applied, grey becomes three equal channels, 16 bits keep their upper 8, CMYK
    is converted, alpha is dropped, of an animation the first frame is taken.

    max_pixels : files whose header announces more are not decoded.

    Raises RowError, whose message has no path in it, when there is no such file or it cannot be
    read as an image; TransientError when the file system fails.
    """
    data = read_bytes(path)
    image = _open(io.BytesIO(data))
    width, height = image.size
    orientation = _orientation(image)
    if width * height > max_pixels:
        raise RowError(
            f"image of {width} x {height} pixels: expected at most {max_pixels} pixels (max_pixels)"
        )
    try:
        image.load()
        pixels = _rgb(image)
    except MemoryError:
        raise
    except Exception as error:  # Pillow's decoders raise nearly every built-in kind
        raise RowError(f"unreadable {image.format} image: {reason(error)}") from error
    return np.ascontiguousarray(turned(pixels, orientation))


def image_size(path: Path) -> tuple[int, int]:
    """(width, height) in px of the image as `read_image` gives it, from the header alone.

    Raises as `read_image` does.
    """
    width, height, _ = image_frame(path)
    return width, height


def image_frame(path: Path) -> tuple[int, int, int]:
    """(width, height) as `image_size`, and the EXIF orientation that led to them, 1 to 8."""
    path = located(path)
    try:
        if isinstance(path, RemotePath):
            with contextlib.suppress(RowError):  # where the header is longer, or at the end
                return _frame(io.BytesIO(path.read_head(_HEADER)))
        if isinstance(path, Path):
            bounded.check_file(path)
        with path.open("rb") as file:
            return _frame(file)
    except OSError as error:
        raise _file_error(error, path) from error


def _frame(file: BinaryIO) -> tuple[int, int, int]:
    image = _open(file)
    (width, height), orientation = image.size, _orientation(image)
    return (height, width, orientation) if orientation >= 5 else (width, height, orientation)


def read_bytes(path: Path) -> bytes:
    """The bytes of a file of the dataset.

    Raises RowError when there is no such file, or one of more bytes than the limit `image` of
    common.bounded; TransientError when the file system fails.
    """
    try:
        return bounded.read(located(path), "image")
    except OSError as error:
        raise _file_error(error, path) from error


def reason(error: Exception) -> str:
    """What a library says of a broken file, the same on every run: without addresses of objects."""
    return re.sub(r" at 0x[0-9a-f]+", "", str(error)) or type(error).__name__


def _file_error(error: OSError, path: Path) -> RowError | TransientError:
    if isinstance(error, (FileNotFoundError, NotADirectoryError)):
        return RowError(MISSING)
    if isinstance(error, IsADirectoryError):
        return RowError("expected a file, found a directory")
    if isinstance(error, bounded.Refused):
        return RowError(str(error))
    if error.errno in (errno.ELOOP, errno.ENAMETOOLONG):
        return RowError(f"cannot be read: {error.strerror}")
    return TransientError(f"{path}: {error.strerror}; the part can be run again")


def _open(file: BinaryIO) -> ImageFile:
    """Pillow's image by its header.

    The classes stand here, instead of Image.open, because its limit on pixels is global to the
    process and it tries every format it knows.
    """
    head = file.read(16)
    file.seek(0)
    for start, name in _MAGIC.items():
        if head.startswith(start):
            module = import_module(f"PIL.{name}ImagePlugin")
            kind: type[ImageFile] = getattr(module, f"{name}ImageFile")
            try:
                return kind(file)
            except Exception as error:  # see read_image
                raise RowError(f"unreadable {kind.format} image: {reason(error)}") from error
    if head[4:8] == b"ftyp":
        return _open_modern(file, head[8:12])
    found = f"a file that begins with {head!r}" if head else "an empty file"
    raise RowError(f"expected {_KINDS}, found {found}")


def _open_modern(file: BinaryIO, brand: bytes) -> ImageFile:
    """Pillow's image of an AVIF or HEIC file, by its brand (ISO/IEC 14496-12, section 4.3)."""
    is_avif = brand in (b"avif", b"avis")
    name, ending = ("AVIF", ".avif") if is_avif else ("HEIC", ".heic")
    if ending not in readable():
        raise RowError(f"{name} image: this Pillow cannot read it; pip install pillow-heif")
    try:
        if is_avif:
            from PIL.AvifImagePlugin import AvifImageFile

            return AvifImageFile(file)
        from pillow_heif import HeifImageFile

        image: ImageFile = HeifImageFile(file)
        return image
    except Exception as error:  # see read_image
        raise RowError(f"unreadable {name} image: {reason(error)}") from error


def _rgb(image: ImageFile) -> np.ndarray:
    """uint8 of shape (height, width, 3), RGB, of a loaded image of any mode."""
    if image.mode.startswith("I;16") or (image.mode == "I" and image.format == "PNG"):
        grey = (np.asarray(image) >> 8).astype(np.uint8)
        return np.repeat(grey[:, :, None], 3, axis=2)
    if image.mode in ("I", "F"):
        raise ValueError(f"expected 8 or 16 bits a channel, found mode {image.mode}")
    # Straight to RGB, Pillow warns of palettes with transparency.
    plain = image.convert("RGBA") if image.mode in ("P", "PA") else image
    return np.asarray(plain if plain.mode == "RGB" else plain.convert("RGB"))


def _orientation(image: ImageFile) -> int:
    """EXIF orientation, 1 to 8; 1 where there is none that makes sense."""
    # Pillow turns TIFF and HEIC by itself. A PNG's EXIF counts where it stands before the pixels:
    # a header is read without them, and both must give the same size.
    if image.format in ("TIFF", "HEIF") or (image.format == "PNG" and "exif" not in image.info):
        return 1
    try:
        value = image.getexif().get(0x0112, 1)
    except Exception:  # broken EXIF around a good image
        return 1
    return value if value in range(1, 9) else 1


def turned(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Pixels as displayed; orientations as in EXIF 2.32, section 4.6.4, tag 0x0112."""
    if orientation >= 5:
        pixels = pixels.transpose(1, 0, 2)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return pixels
