"""SUN RGB-D and SUN3D: rotated depth bits, the frames' folders, pairing by time."""

import cv2
import numpy as np
import pytest

from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.datasets.folder import folder
from rsa_data.datasets.index import open_dataset
from rsa_data.datasets.sun3d import sun3d
from rsa_data.datasets.sunrgbd import sunrgbd
from rsa_data.store import schemas

MATRIX = "520.5 0 277.9 0 520.7 215.1 0 0 1\n"
CAMERA = {"fx": 520.5, "fy": 520.7, "cx": 277.9, "cy": 215.1}


def write(root, path, text=""):
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    (root / path).write_text(text)


def rows(dataset, root, *columns):
    table = dataset.index(root, None)
    schemas.check("samples", table)
    return [tuple(row.values()) for row in table.select(columns).to_pylist()]


@pytest.mark.parametrize("dataset", [sunrgbd(), sun3d()], ids=lambda d: d.name)
def test_every_rotated_value_comes_back(tmp_path, dataset):
    millimetres = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    # The toolbox undoes it by bitor(bitshift(d, -3), bitshift(d, 13)).
    stored = (millimetres.astype(np.uint32) << 3) | (millimetres >> 13)
    cv2.imwrite(str(tmp_path / "d.png"), stored.astype(np.uint16))
    expected = millimetres.astype(np.float32) / np.float32(1000)
    np.testing.assert_array_equal(dataset.read_depth(tmp_path / "d.png"), expected)


def test_the_real_frame_in_metres(tmp_path, shared):
    given = cv2.imread(
        str(shared / "rgbd" / "sunrgbd" / "000017_depth_derived.png"), cv2.IMREAD_UNCHANGED
    )
    rotated = (given.astype(np.uint32) << 3 | given >> 13).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "d.png"), rotated)
    depth = sunrgbd().read_depth(tmp_path / "d.png")
    np.testing.assert_array_equal(depth, given.astype(np.float32) / np.float32(1000))
    assert 0.5 < np.median(depth[depth > 0]) < 8


KV2 = "kv2/kinect2data/000002_2014-05-26_14-23-37_260595134347_rgbf000103-resize"
XTION = "xtion/sun3ddata/mit_32_d507/d507_1/0000008-000000234612"


@pytest.fixture
def sun(tmp_path):
    """Two frames on disk, one of them in the test list, and one listed that is not there."""
    for key, image, depth in (
        (KV2, "0000103.jpg", "0000103.png"),
        (XTION, "0000008-000000234612.jpg", "0000007-000000224813.png"),
        ("kv1/NYUdata/NYU0002", "NYU0002.jpg", "NYU0002.png"),
    ):
        write(tmp_path, f"SUNRGBD/{key}/image/{image}")
        write(tmp_path, f"SUNRGBD/{key}/depth/{depth}")
        write(tmp_path, f"SUNRGBD/{key}/depth_bfx/{depth}")
        write(tmp_path, f"SUNRGBD/{key}/fullres/{image}")
    write(tmp_path, f"SUNRGBD/{KV2}/intrinsics.txt", MATRIX)
    listed = [f"SUNRGBD/{KV2}/image/0000103.jpg SUNRGBD/{KV2}/depth/0000103.png"]
    gone = "SUNRGBD/kv1/NYUdata/NYU0001"
    listed.append(f"{gone}/image/NYU0001.jpg {gone}/depth/NYU0001.png")
    write(tmp_path, "SUNRGBD_val_splits.txt", "\n".join(listed))
    return tmp_path


@pytest.mark.parametrize("depth", ["depth", "depth_bfx"])
def test_sunrgbd_layout(sun, depth):
    found = rows(sunrgbd(depth=depth), sun, "sample_id", "scene", "image", "depth", "fx")
    nyu = "SUNRGBD/kv1/NYUdata"
    assert found == [
        (
            "sunrgbd/test/kv1/NYUdata/NYU0001",
            "kv1/NYUdata",
            f"{nyu}/NYU0001/image/NYU0001.jpg",
            None,
            None,
        ),
        (
            f"sunrgbd/test/{KV2}",
            KV2,
            f"SUNRGBD/{KV2}/image/0000103.jpg",
            f"SUNRGBD/{KV2}/{depth}/0000103.png",
            520.5,
        ),
        (
            "sunrgbd/train/kv1/NYUdata/NYU0002",
            "kv1/NYUdata",
            f"{nyu}/NYU0002/image/NYU0002.jpg",
            f"{nyu}/NYU0002/{depth}/NYU0002.png",
            None,
        ),
        (
            f"sunrgbd/train/{XTION}",
            "xtion/sun3ddata/mit_32_d507",
            f"SUNRGBD/{XTION}/image/0000008-000000234612.jpg",
            f"SUNRGBD/{XTION}/{depth}/0000007-000000224813.png",
            None,
        ),
    ]


def test_sunrgbd_says_what_is_wrong(sun):
    write(sun, f"SUNRGBD/{KV2}/depth/second.png")
    with pytest.raises(RsaDataError, match=r"depth: expected one file, found 2"):
        sunrgbd().index(sun, None)
    write(sun, "SUNRGBD_val_splits.txt", "kv2/image/1.jpg kv2/depth/1.png")
    with pytest.raises(RsaDataError, match=r"val_splits.txt line 1: expected `SUNRGBD/"):
        sunrgbd().index(sun, None)
    (sun / "SUNRGBD_val_splits.txt").unlink()
    with pytest.raises(RsaDataError, match=r"expected the test list .*list datasets sun"):
        sunrgbd().index(sun, None)


@pytest.fixture
def video(tmp_path):
    """Colour at 0, 33 and 67 ms; the depth frame of 33 ms is lost and that of 67 comes late."""
    sequence = "hotel_umd/maryland_hotel3"
    for number, time in enumerate((0, 33369, 66737)):
        write(tmp_path, f"{sequence}/image/{number:07d}-{time:012d}.jpg")
    for number, time in enumerate((0, 75000, 900000)):
        write(tmp_path, f"{sequence}/depth/{number:07d}-{time:012d}.png")
    write(tmp_path, f"{sequence}/intrinsics.txt", MATRIX)
    write(tmp_path, f"{sequence}/image/thumbs.db")
    return tmp_path


def test_sun3d_pairs_by_time(video):
    sequence = "hotel_umd/maryland_hotel3"
    found = rows(sun3d(), video, "sample_id", "scene", "image", "depth")
    assert found == [
        (
            f"sun3d/train/{sequence}/{image}",
            "hotel_umd",
            f"{sequence}/image/{image}.jpg",
            depth and f"{sequence}/depth/{depth}.png",
        )
        for image, depth in (
            ("0000000-000000000000", "0000000-000000000000"),
            ("0000001-000000033369", "0000000-000000000000"),
            ("0000002-000000066737", "0000001-000000075000"),
        )
    ]
    assert rows(sun3d(every=2), video, "depth", *CAMERA) == [
        (found[0][3], *CAMERA.values()),
        (found[2][3], *CAMERA.values()),
    ]


def test_sun3d_without_a_depth_frame_near_has_none(video):
    (video / "hotel_umd/maryland_hotel3/depth/0000001-000000075000.png").unlink()
    assert rows(sun3d(every=2), video, "depth")[1] == (None,)


def test_sun3d_test_list(video):
    write(video, "test.txt", "hotel_umd/maryland_hotel3\n")
    found = rows(sun3d(test_list=video / "test.txt"), video, "split")
    assert found == [("test",)] * 3
    write(video, "test.txt", "hotel_umd/maryland\n")
    with pytest.raises(RsaDataError, match=r"test.txt line 1: expected a sequence below"):
        sun3d(test_list=video / "test.txt").index(video, None)
    with pytest.raises(UsageError, match="every: expected a whole number, 1 or more; found 0"):
        open_dataset("sun3d", {"every": 0})


OTHERS = {
    "TUM": ("TUM_depth.png", "m/5000", "TUM_depth_mm_derived.png"),
    "Redwood": ("redwood_00000_depth.png", "mm", "redwood_00000_depth.png"),
}


@pytest.mark.parametrize(("name", "unit", "millimetres"), OTHERS.values(), ids=OTHERS)
def test_depth_of_other_cameras_through_the_folder_dataset(shared, name, unit, millimetres):
    misc = shared / "rgbd" / "misc"
    depth = folder(depth="depth", depth_unit=unit).read_depth(misc / name)
    expected = cv2.imread(str(misc / millimetres), cv2.IMREAD_UNCHANGED) / 1000
    # The derived file is rounded to mm.
    np.testing.assert_allclose(depth, expected, atol=5.1e-4)
    assert 0.5 < np.median(depth[depth > 0]) < 5
