"""Cameras of photos: options, EXIF data as cameras write it, an assumption that is stated."""

import numpy as np
import pytest
from PIL import Image

from rsa_data.common.errors import UsageError
from rsa_data.heads.predict.camera import camera_of
from rsa_data.heads.predict.choices import View


def photo(path, size, tags, orientation=None):
    """A JPEG with tags of the EXIF sub-directory."""
    exif = Image.Exif()
    exif.get_ifd(0x8769).update(tags)
    if orientation:
        exif[0x0112] = orientation
    Image.new("RGB", size).save(path, exif=exif)
    return path


def test_focal_length_equivalent_to_35_mm(tmp_path):
    """An iPhone's main camera, 26 mm: its diagonal sees what 26 mm see on 43.27 mm of film."""
    path = photo(tmp_path / "p.jpg", (400, 300), {0xA405: 26})
    camera = camera_of(path, 400, 300)
    assert camera.fx == camera.fy == pytest.approx(26 / np.hypot(36, 24) * 500)
    assert (camera.cx, camera.cy) == (200, 150) and "26 mm equivalent" in camera.source
    diagonal = 2 * np.arctan(250 / camera.fx)
    assert diagonal == pytest.approx(2 * np.arctan(np.hypot(36, 24) / 2 / 26))


def test_a_portrait_photo_keeps_its_focal_length(tmp_path):
    path = photo(tmp_path / "p.jpg", (400, 300), {0xA405: 26}, orientation=6)
    camera = camera_of(path, 300, 400)  # as it is meant to be seen
    assert camera.fx == pytest.approx(26 / np.hypot(36, 24) * 500)
    assert (camera.cx, camera.cy) == (150, 200)


def test_focal_length_and_resolution_of_the_sensor(tmp_path):
    """50 mm on a sensor of 36 mm over 6000 px, the photo shrunk to 600 px."""
    tags = {0x920A: 50.0, 0xA20E: 6000 / 36, 0xA210: 4, 0xA002: 6000}
    camera = camera_of(photo(tmp_path / "p.jpg", (600, 400), tags), 600, 400)
    assert camera.fx == pytest.approx(50 / 36 * 600, rel=1e-3) and "50 mm" in camera.source


@pytest.mark.parametrize("tags", [{}, {0xA405: 0}, {0x920A: 4.2}])
def test_without_a_focal_length_a_view_is_assumed_and_said(tmp_path, tags):
    camera = camera_of(photo(tmp_path / "p.jpg", (400, 300), tags), 400, 300)
    assert camera.view == pytest.approx(65) and "assumed" in camera.source


def test_options_come_first(tmp_path):
    path = photo(tmp_path / "p.jpg", (400, 300), {0xA405: 26})
    camera = camera_of(path, 400, 300, View(intrinsics="500,510,201,149"))
    assert camera.at(200, 150) == (250, 255, 100.5, 74.5)
    assert camera_of(path, 400, 300, View(fov=90)).fx == pytest.approx(200)
    with pytest.raises(UsageError, match="at least 1 px"):
        camera_of(path, 400, 300, View(intrinsics="-5,5,1,1"))
    with pytest.raises(UsageError, match="multiply fx and cx by the width"):
        camera_of(path, 400, 300, View(intrinsics="0.8,1.1,0.5,0.5"))
    with pytest.raises(UsageError, match="leave one out"):
        camera_of(path, 400, 300, View(intrinsics="500,510,201,149", fov=60))


def test_damaged_metadata_is_no_camera(tmp_path):
    path = photo(tmp_path / "p.jpg", (40, 30), {0xA405: 26})
    data = bytearray(path.read_bytes())
    at = data.index(b"Exif")
    data[at + 6 : at + 30] = b"\xff" * 24
    path.write_bytes(data)
    assert "assumed" in camera_of(path, 40, 30).source
