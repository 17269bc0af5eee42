"""HEIC and AVIF as phones write them, where Pillow reads them; else counted and named."""

import numpy as np
import pytest
from PIL import Image, ImageOps, features

from rsa_data.common.errors import RowError
from rsa_data.datasets.folder import folder
from rsa_data.datasets.images import image_size, read_image


def picture():
    """Red above, green below; 64 x 48 px, so that a turn shows."""
    pixels = np.zeros((48, 64, 3), np.uint8)
    pixels[:24, :, 0], pixels[24:, :, 1] = 220, 220
    return Image.fromarray(pixels)


def turned(orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    return exif.tobytes()


@pytest.mark.parametrize("orientation", [1, 6])
@pytest.mark.parametrize("kind", ["heic", "avif"])
def test_phones_photos_are_read_upright_once(tmp_path, kind, orientation):
    path = tmp_path / f"a.{kind}"
    if kind == "heic":
        heif = pytest.importorskip("pillow_heif")
        heif.from_pillow(picture()).save(path, quality=95, exif=turned(orientation))
        heif.register_heif_opener()
        with Image.open(path) as image:
            oracle = np.asarray(image.convert("RGB"))
    else:
        if not features.check("avif"):
            pytest.skip("this Pillow has no AVIF")
        picture().save(path, quality=95, exif=turned(orientation))
        with Image.open(path) as image:
            oracle = np.asarray(ImageOps.exif_transpose(image).convert("RGB"))
    found = read_image(path)
    assert image_size(path) == (found.shape[1], found.shape[0])
    np.testing.assert_array_equal(found, oracle)
    # Orientation 6 is shown turned clockwise: what was above lies at the right.
    red = found[:, -10:] if orientation == 6 else found[:10]
    assert found.shape == ((64, 48, 3) if orientation == 6 else (48, 64, 3))
    assert red[..., 0].mean() > 150 > red[..., 1].mean()
    found = folder().index(tmp_path, None)
    assert found["image"].to_pylist() == [f"a.{kind}"]


@pytest.mark.parametrize(("name", "brand"), [("a.heic", b"heic"), ("a.avif", b"avif")])
def test_a_broken_one_says_so(tmp_path, name, brand):
    (tmp_path / name).write_bytes(b"\0\0\0\x18ftyp" + brand + bytes(40))
    with pytest.raises(RowError, match=r"unreadable|cannot read it; pip install pillow-heif"):
        read_image(tmp_path / name)
