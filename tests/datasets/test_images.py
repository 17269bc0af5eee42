"""Images of every kind and damage, against Pillow's and OpenCV's own conversions."""

import io
import os
import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image, ImageOps

from rsa_data.common.errors import RowError, TransientError
from rsa_data.datasets.images import image_size, read_image

RGB = np.random.default_rng(0).integers(0, 256, (5, 7, 3), np.uint8)
# A photograph-like picture: JPEG keeps it nearly as it is.
SMOOTH = cv2.resize(RGB, (64, 48), interpolation=cv2.INTER_CUBIC)


def encoded(image: Image.Image, kind: str, **options) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def put(folder, data: bytes, name: str = "image.bin"):
    path = folder / name
    path.write_bytes(data)
    return path


def test_jpeg_pixels_are_opencvs(tmp_path):
    data = encoded(Image.fromarray(SMOOTH), "JPEG")
    path = put(tmp_path, data)
    expected = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]
    np.testing.assert_array_equal(read_image(path), expected)
    assert image_size(path) == (64, 48)


def grey_steps():
    return np.arange(35, dtype=np.uint16).reshape(5, 7) * 1800


PALETTE = Image.fromarray(RGB).quantize(16)
LOSSLESS = {
    "rgb": (encoded(Image.fromarray(RGB), "PNG"), RGB),
    "bmp": (encoded(Image.fromarray(RGB), "BMP"), RGB),
    "webp": (encoded(Image.fromarray(RGB), "WEBP", lossless=True), RGB),
    "tiff": (encoded(Image.fromarray(RGB), "TIFF"), RGB),
    "one pixel": (encoded(Image.fromarray(RGB[:1, :1]), "PNG"), RGB[:1, :1]),
    "grey": (encoded(Image.fromarray(RGB[:, :, 0]), "PNG"), RGB[:, :, [0, 0, 0]]),
    "black and white": (
        encoded(Image.fromarray(RGB[:, :, 0] > 99), "PNG"),
        np.where(RGB[:, :, [0, 0, 0]] > 99, 255, 0).astype(np.uint8),
    ),
    "alpha": (encoded(Image.fromarray(np.dstack([RGB, RGB[:, :, 0]])), "PNG"), RGB),
    "grey and alpha": (
        encoded(Image.fromarray(RGB[:, :, :2].copy(), "LA"), "PNG"),
        RGB[:, :, [0, 0, 0]],
    ),
    "palette": (encoded(PALETTE, "PNG"), np.asarray(PALETTE.convert("RGB"))),
    "palette with transparency": (
        encoded(PALETTE, "PNG", transparency=bytes(range(16))),
        np.asarray(PALETTE.convert("RGB")),
    ),
    "16-bit grey": (
        cv2.imencode(".png", grey_steps())[1].tobytes(),
        np.repeat((grey_steps() // 256).astype(np.uint8)[:, :, None], 3, axis=2),
    ),
    "16-bit grey tiff": (
        cv2.imencode(".tiff", grey_steps())[1].tobytes(),
        np.repeat((grey_steps() // 256).astype(np.uint8)[:, :, None], 3, axis=2),
    ),
    "16-bit colour": (
        cv2.imencode(".png", (RGB[:, :, ::-1].astype(np.uint16) << 8) + 200)[1].tobytes(),
        RGB,
    ),
    "animated gif": (
        encoded(
            PALETTE,
            "GIF",
            save_all=True,
            append_images=[Image.new("P", PALETTE.size)],
        ),
        np.asarray(PALETTE.convert("RGB")),
    ),
    "animated png": (
        encoded(
            Image.fromarray(RGB),
            "PNG",
            save_all=True,
            append_images=[Image.new("RGB", (7, 5))],
        ),
        RGB,
    ),
    "animated webp": (
        encoded(
            Image.fromarray(RGB),
            "WEBP",
            lossless=True,
            save_all=True,
            append_images=[Image.new("RGB", (7, 5))],
        ),
        RGB,
    ),
}


@pytest.mark.parametrize(("data", "expected"), LOSSLESS.values(), ids=LOSSLESS)
def test_every_kind_becomes_rgb_of_8_bits(tmp_path, data, expected):
    path = put(tmp_path, data)
    read = read_image(path)
    np.testing.assert_array_equal(read, expected)
    assert (read.dtype, read.flags.c_contiguous) == (np.uint8, True)
    assert image_size(path) == expected.shape[1::-1]


def test_cmyk_jpeg_has_the_colours_of_its_rgb(tmp_path):
    cmyk = Image.fromarray(SMOOTH).convert("CMYK")
    read = read_image(put(tmp_path, encoded(cmyk, "JPEG", quality=100)))
    assert np.abs(read.astype(int) - SMOOTH).mean() < 3


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "WEBP", "TIFF"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_rotation_is_applied(tmp_path, kind, orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    data = encoded(Image.fromarray(SMOOTH), kind, exif=exif)
    path = put(tmp_path, data)
    expected = np.asarray(ImageOps.exif_transpose(Image.open(io.BytesIO(data))).convert("RGB"))
    np.testing.assert_array_equal(read_image(path), expected)
    assert image_size(path) == expected.shape[1::-1]


@pytest.mark.filterwarnings("ignore:Corrupt EXIF data:UserWarning")
def test_broken_exif_around_a_good_image_is_ignored(tmp_path):
    data = encoded(Image.fromarray(SMOOTH), "JPEG", exif=b"Exif\0\0II*\0\xff\xff\xff\xff")
    assert read_image(put(tmp_path, data)).shape == (48, 64, 3)


def png_of_size(width: int, height: int) -> bytes:
    """A PNG whose header announces the size and whose data is one compressed zero byte."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b"\0"))
        + chunk(b"IEND", b"")
    )


JPEG = encoded(Image.fromarray(SMOOTH), "JPEG")
PNG = encoded(Image.fromarray(SMOOTH), "PNG")
FLOAT = encoded(Image.fromarray(np.ones((2, 2), np.float32)), "TIFF")
BROKEN = {
    "empty": (b"", "expected a JPEG, PNG, WebP, BMP, GIF or TIFF image, found an empty file"),
    "text": (
        b"version https://git-lfs.github.com/spec/v1\n",
        "expected a JPEG, PNG, WebP, BMP, GIF or TIFF image, found a file that begins with "
        "b'version https://'",
    ),
    "bomb": (
        png_of_size(60_000, 60_000),
        "image of 60000 x 60000 pixels: expected at most 100000000 pixels (max_pixels)",
    ),
    "float": (FLOAT, "unreadable TIFF image: expected 8 or 16 bits a channel, found mode F"),
    "jpeg cut in the pixels": (JPEG[: len(JPEG) * 3 // 4], "unreadable JPEG image: "),
    "jpeg cut in the header": (JPEG[:100], "unreadable JPEG image: "),
    "jpeg, first bytes only": (JPEG[:4], "unreadable JPEG image: "),
    "png cut in the pixels": (PNG[: len(PNG) * 3 // 4], "unreadable PNG image: "),
    "png, signature only": (PNG[:8], "unreadable PNG image: "),
    "png of no size": (png_of_size(0, 5), "unreadable PNG image: "),
}


@pytest.mark.parametrize(("data", "reason"), BROKEN.values(), ids=BROKEN)
def test_what_cannot_be_read_says_why_without_its_path(tmp_path, data, reason):
    with pytest.raises(RowError) as caught:
        read_image(put(tmp_path, data))
    assert str(caught.value).startswith(reason)
    assert str(tmp_path) not in str(caught.value) and "0x" not in str(caught.value)


@pytest.mark.parametrize("read", [read_image, image_size])
def test_directories_and_missing_files_are_row_errors(tmp_path, read):
    (tmp_path / "directory.jpg").mkdir()
    with pytest.raises(RowError, match=r"^expected a file, found a directory$"):
        read(tmp_path / "directory.jpg")
    with pytest.raises(RowError, match=r"^no such file$"):
        read(tmp_path / "missing.jpg")


@pytest.mark.parametrize("read", [read_image, image_size])
def test_a_failing_file_system_is_transient(tmp_path, read):
    broken = tmp_path / "broken.jpg"
    broken.symlink_to("/proc/self/mem")  # reading its beginning is an I/O error
    with pytest.raises(TransientError, match="can be run again"):
        read(broken)


@pytest.mark.parametrize("read", [read_image, image_size])
def test_a_link_to_itself_is_a_failed_row(tmp_path, read):
    loop = tmp_path / "loop.jpg"
    loop.symlink_to(loop)
    with pytest.raises(RowError, match="cannot be read"):
        read(loop)


def test_a_file_of_20_gb_is_a_failed_row(tmp_path):
    path = put(tmp_path, JPEG)
    os.truncate(path, 20 << 30)
    with pytest.raises(RowError, match=r"expected at most 512\.0 MB, found 21\.5 GB; RSA_DATA_L"):
        read_image(path)


def test_max_pixels_is_an_option(tmp_path):
    path = put(tmp_path, PNG)
    assert read_image(path, max_pixels=48 * 64).shape == (48, 64, 3)
    with pytest.raises(RowError, match="64 x 48 pixels: expected at most 3071 pixels"):
        read_image(path, max_pixels=48 * 64 - 1)


def test_pillows_own_limit_does_not_matter(tmp_path, monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 10)
    assert read_image(put(tmp_path, JPEG)).shape == (48, 64, 3)


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_damaged_files_are_an_image_or_a_row_error(tmp_path, data):
    good, _ = data.draw(st.sampled_from([*LOSSLESS.values(), (JPEG, None)]))
    damaged = bytearray(good)
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(good)))
    path = put(tmp_path, bytes(damaged[:cut] if data.draw(st.booleans()) else damaged))
    try:
        read = read_image(path, max_pixels=100_000)
    except RowError:
        return
    assert (read.dtype, read.ndim, read.shape[2]) == (np.uint8, 3, 3)


def test_every_cut_of_a_jpeg_before_its_last_bytes_is_found(tmp_path):
    # The end marker and up to a few bits of padding hold no pixels.
    for cut in range(0, len(JPEG) - 4, 7):
        with pytest.raises(RowError):
            read_image(put(tmp_path, JPEG[:cut]))
