"""Datasets on layouts made of empty files, and on the real files beside a checkout."""

import tarfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from rsa_data import registry
from rsa_data.common.errors import RsaDataError
from rsa_data.datasets import bts
from rsa_data.datasets.kitti import kitti
from rsa_data.datasets.listing import inside
from rsa_data.datasets.nyuv2 import CAMERA, nyuv2
from rsa_data.datasets.seven_scenes import seven_scenes
from rsa_data.datasets.void import void
from rsa_data.store import schemas


def touch(root, *paths):
    for path in paths:
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).touch()


def write(root, path, text):
    touch(root, path)
    (root / path).write_text(text)


def row(sample_id, scene, image, depth, camera=(None,) * 4):
    name, split, _ = sample_id.split("/", 2)
    return {
        "sample_id": sample_id,
        "dataset": name,
        "split": split,
        "scene": scene,
        "image": image,
        "depth": depth,
        "width": None,
        "height": None,
        **dict(zip(("fx", "fy", "cx", "cy"), camera, strict=True)),
    }


def rows(dataset, root, split=None):
    table = dataset.index(root, split)
    schemas.check("samples", table)
    return table.to_pylist()


NYU_FILES = (
    "sync/bedroom_0001b/rgb_00002.jpg",
    "sync/bedroom_0001b/sync_depth_00002.png",
    "sync/bedroom_0001a/rgb_00001.jpg",
    "sync/bedroom_0001a/sync_depth_00001.png",
    "sync/bedroom_0001a/rgb_00009.jpg",  # no depth
    "official_splits/test/bathroom/rgb_00045.jpg",
    "official_splits/test/bathroom/sync_depth_00045.png",
)
NYU_ROWS = [
    row(
        "nyuv2/test/bathroom/rgb_00045",
        "bathroom",
        "official_splits/test/bathroom/rgb_00045.jpg",
        "official_splits/test/bathroom/sync_depth_00045.png",
        CAMERA,
    ),
    row(
        "nyuv2/train/bedroom_0001a/rgb_00001",
        "bedroom_0001",
        "sync/bedroom_0001a/rgb_00001.jpg",
        "sync/bedroom_0001a/sync_depth_00001.png",
        CAMERA,
    ),
    row(
        "nyuv2/train/bedroom_0001b/rgb_00002",
        "bedroom_0001",
        "sync/bedroom_0001b/rgb_00002.jpg",
        "sync/bedroom_0001b/sync_depth_00002.png",
        CAMERA,
    ),
]


def test_nyuv2_without_split_files_takes_pairs(tmp_path):
    touch(tmp_path, *NYU_FILES)
    assert rows(nyuv2(), tmp_path) == NYU_ROWS
    assert rows(nyuv2(), tmp_path, "test") == NYU_ROWS[:1]


@pytest.mark.parametrize("folder", ["", "train_test_inputs/", "data_splits/"])
def test_nyuv2_split_files_decide_and_none_is_no_depth(tmp_path, folder):
    touch(tmp_path, *NYU_FILES)
    write(
        tmp_path,
        f"{folder}nyudepthv2_train_files_with_gt.txt",
        "/bedroom_0001b/rgb_00002.jpg /bedroom_0001b/sync_depth_00002.png 518.8579\r\n"
        "\n/bedroom_0001a/rgb_00009.jpg None 518.8579",
    )
    nine = row(
        "nyuv2/train/bedroom_0001a/rgb_00009",
        "bedroom_0001",
        "sync/bedroom_0001a/rgb_00009.jpg",
        None,
        CAMERA,
    )
    assert rows(nyuv2(), tmp_path) == [NYU_ROWS[0], nine, NYU_ROWS[2]]


def test_nyuv2_takes_a_split_file_from_elsewhere(tmp_path):
    touch(tmp_path / "data", *NYU_FILES)
    write(tmp_path, "mine.txt", "bathroom/rgb_00045.jpg bathroom/sync_depth_00045.png 518.8579\n")
    given_list = nyuv2(test_list=tmp_path / "mine.txt")
    assert rows(given_list, tmp_path / "data", "test") == NYU_ROWS[:1]


def test_nyuv2_keys_are_those_of_the_released_text(tmp_path, shared):
    with tarfile.open(shared / "rsa_release" / "nyu-test.tar.xz") as archive:
        names = [n for n in archive.getnames() if "seg_txt_panoptic/" in n and n.endswith(".txt")]
    keys = sorted(n.removesuffix(".txt").split("nyu/test/")[1] for n in names)
    for key in keys:
        touch(
            tmp_path / "official_splits" / "test",
            f"{key}.jpg",
            f"{key.replace('rgb_', 'sync_depth_')}.png",
        )
    found = nyuv2().index(tmp_path, "test")
    assert found["sample_id"].to_pylist() == [f"nyuv2/test/{key}" for key in keys]
    assert len(keys) == 654


def test_nyuv2_border():
    mask = nyuv2().train_mask(480, 640)
    expected = np.zeros((480, 640), bool)
    expected[45:472, 43:608] = True  # RSA's dataloader.py
    np.testing.assert_array_equal(mask, expected)


DRIVE = "2011_09_26_drive_0002_sync"
DEPTH = f"{DRIVE}/proj_depth/groundtruth/image_02/0000000069.png"
KITTI_LIST = (
    f"2011_09_26/{DRIVE}/image_02/data/0000000069.png {DEPTH} 721.5377\n"
    f"2011_09_26/{DRIVE}/image_02/data/0000000070.png None 721.5377\n"
)


@pytest.mark.parametrize("raw", ["", "raw/", "kitti_raw_data/"])
@pytest.mark.parametrize(
    "truth", ["data_depth_annotated", "data_depth_annotated/val", "kitti_ground_truth"]
)
def test_kitti_finds_its_folders(tmp_path, raw, truth):
    write(tmp_path, "eigen_test_files_with_gt.txt", KITTI_LIST)
    touch(tmp_path, f"{truth}/{DEPTH}")
    key = f"2011_09_26/{DRIVE}/image_02/data/00000000"
    (tmp_path / raw / "2011_09_26").mkdir(parents=True)
    camera = (721.5377, 721.5377, None, None)
    assert rows(kitti(), tmp_path) == [
        row(f"kitti/test/{key}69", DRIVE, f"{raw}{key}69.png", f"{truth}/{DEPTH}", camera),
        row(f"kitti/test/{key}70", DRIVE, f"{raw}{key}70.png", None, camera),
    ]


def test_kitti_prefers_the_calibration(tmp_path):
    write(tmp_path, "eigen_test_files_with_gt.txt", KITTI_LIST)
    matrix = "P_rect_02: 7.2e+02 0 6.1e+02 44.8 0 7.3e+02 1.7e+02 0.2 0 0 1 0.003\n"
    write(tmp_path, "2011_09_26/calib_cam_to_cam.txt", f"S_02: 1392 512\n{matrix}")
    found = kitti().index(tmp_path, "test").select(["fx", "fy", "cx", "cy"]).to_pylist()
    assert found == [{"fx": 720.0, "fy": 730.0, "cx": 610.0, "cy": 170.0}] * 2


def test_kitti_crop():
    mask = kitti().train_mask(375, 1242)
    expected = np.zeros((375, 1242), bool)
    expected[23:, 13:1229] = True  # BTS: top = 375 - 352, left = int((1242 - 1216) / 2)
    np.testing.assert_array_equal(mask, expected)
    assert kitti().train_mask(300, 1000).all()


def test_void_reads_its_lists(tmp_path):
    key = "void_1500/data/copyroom4/image/1552625641.7700"
    truth = key.replace("image", "ground_truth") + ".png"
    write(tmp_path, "void_1500/test_image.txt", f"{key}.png\n")
    write(tmp_path, "void_1500/test_ground_truth.txt", f"{truth}\n")
    write(tmp_path, "void_1500/data/copyroom4/K.txt", "5e2 0 3.2e2\n0 5.1e2 2.4e2\n0 0 1\n")
    expected = [row(f"void/test/{key}", "copyroom", f"{key}.png", truth, (500, 510, 320, 240))]
    assert rows(void(), tmp_path, "test") == expected
    assert void().key_paths("test", key) == (f"{key}.png", truth)


def test_7scenes_official_layout(tmp_path):
    for sequence in ("seq-01", "seq-02", "seq-03"):
        touch(tmp_path, f"chess/{sequence}/frame-000000.color.png")
        touch(tmp_path, f"chess/{sequence}/frame-000000.depth.png")
    write(tmp_path, "chess/TrainSplit.txt", "sequence1\n")
    write(tmp_path, "chess/TestSplit.txt", "sequence3\n")
    camera = (585.0, 585.0, 320.0, 240.0)
    assert rows(seven_scenes(), tmp_path) == [
        row(
            f"7scenes/{split}/chess/{sequence}/frame-000000",
            "chess",
            f"chess/{sequence}/frame-000000.color.png",
            f"chess/{sequence}/frame-000000.depth.png",
            camera,
        )
        for split, sequence in (("test", "seq-03"), ("train", "seq-01"))
    ]


def test_7scenes_last_frames_are_the_test(shared):
    dataset, root = seven_scenes(test_last=20), shared / "rgbd" / "7scenes"
    table = dataset.index(root, None)
    expected = [f"7scenes/test/frame-{n:06d}" for n in range(800, 1000, 10)]
    expected += [f"7scenes/train/frame-{n:06d}" for n in range(0, 800, 10)]
    assert table["sample_id"].to_pylist() == expected
    assert all((root / path).is_file() for path in table["image"].to_pylist())
    depth = dataset.read_depth(root / table["depth"][0].as_py())
    assert depth.shape == (480, 640) and 0.3 < np.median(depth[depth > 0]) < 5


@pytest.mark.parametrize("name", ["nyuv2", "kitti", "void", "7scenes", "folder"])
def test_a_missing_root_names_the_way_out(tmp_path, name):
    dataset = registry.resolve("dataset", registry.DATASETS, name)()
    with pytest.raises(RsaDataError, match=rf"{name}: expected .*list datasets {name}`"):
        dataset.index(tmp_path / "nowhere", None)
    with pytest.raises(RsaDataError, match=rf"{name}: .*see `rsa-data list datasets {name}`"):
        dataset.index(tmp_path, None)


BAD_LINES = {
    "two fields": ("a/rgb_1.jpg 518.8", "expected `image depth focal`, found 2 fields"),
    "focal is a word": (
        "a/rgb_1.jpg None wide",
        "expected a focal length above 0 px, found 'wide'",
    ),
    "focal is nan": ("a/rgb_1.jpg None nan", "expected a focal length above 0 px, found 'nan'"),
    "upwards": ("../a/rgb_1.jpg None 518.8", "below the dataset's root, found '../a/rgb_1.jpg'"),
    "depth upwards": ("a/1.jpg a/../../1.png 5", "below the dataset's root, found 'a/../../1.png'"),
    "twice absolute": ("//etc/passwd None 5", "below the dataset's root, found '//etc/passwd'"),
}


@pytest.mark.parametrize(("line", "reason"), BAD_LINES.values(), ids=BAD_LINES)
def test_a_bad_split_line_is_named(tmp_path, line, reason):
    touch(tmp_path, *NYU_FILES)
    good = "bathroom/rgb_00045.jpg bathroom/sync_depth_00045.png 518.8579\n"
    write(tmp_path, "nyudepthv2_test_files_with_gt.txt", good + line)
    with pytest.raises(RsaDataError) as caught:
        nyuv2().index(tmp_path, None)
    assert "nyudepthv2_test_files_with_gt.txt line 2: expected" in str(caught.value)
    assert reason in str(caught.value)


def test_the_same_image_twice_is_an_error(tmp_path):
    touch(tmp_path, *NYU_FILES)
    write(tmp_path, "nyudepthv2_test_files_with_gt.txt", "b/rgb_1.jpg None 5\nb/rgb_1.jpg None 5\n")
    with pytest.raises(RsaDataError, match="same key test/b/rgb_1"):
        nyuv2().index(tmp_path, None)


def test_void_lists_of_different_length_are_an_error(tmp_path):
    write(tmp_path, "void_1500/test_image.txt", "void_1500/data/a/image/1.png\n")
    write(tmp_path, "void_1500/test_ground_truth.txt", "")
    with pytest.raises(RsaDataError, match=r"as many lines .* as in test_image.txt \(1\), found 0"):
        void().index(tmp_path, "test")


@settings(
    max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.binary(max_size=60) | st.text("ab/. \nN\0one15-e", max_size=60).map(str.encode))
def test_any_split_file_is_read_or_refused(tmp_path, data):
    path = tmp_path / "list.txt"
    path.write_bytes(data)
    try:
        found = list(bts.read(path, "nyuv2"))
    except RsaDataError as error:
        assert str(path) in str(error)
        return
    for image, depth, focal in found:
        assert inside(image, "") == image and 0 < focal < float("inf")
        assert depth is None or ".." not in depth.split("/")


def test_nyus_camera_and_unit_are_those_of_its_toolbox_and_of_bts(tmp_path):
    # camera_params.m: fx_rgb, fy_rgb, cx_rgb, cy_rgb; BTS' dataloader divides NYU's depth by 1000.
    assert CAMERA == (5.1885790117450188e02, 5.1946961112127485e02,
                      3.2558244941119034e02, 2.5373616633400465e02)  # fmt: skip
    Image.fromarray(np.array([[0, 1, 1000, 9999]], np.uint16)).save(tmp_path / "depth.png")
    depth = nyuv2().read_depth(tmp_path / "depth.png")
    np.testing.assert_allclose(depth, [[0, 0.001, 1, 9.999]], rtol=1e-6)
    assert (nyuv2().min_depth, nyuv2().max_depth) == (1e-3, 10.0)  # of BTS' evaluation


def test_nyus_border_is_where_bts_crops():
    # Rows 45 to 471 and columns 43 to 607 of 480 x 640 (BTS, eval mask "crop 45:472, 43:608").
    mask = nyuv2().train_mask(480, 640)
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    assert (rows[0], rows[-1], columns[0], columns[-1]) == (45, 471, 43, 607)
    assert mask.sum() == 427 * 565
