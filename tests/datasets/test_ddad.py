"""DDAD: LiDAR projected into the cameras, against depth made elsewhere and a closed form."""

import json
import tempfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from ddad_scene import pose, write_scene
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rsa_data.common.errors import RowError, RsaDataError
from rsa_data.datasets.ddad import ddad
from rsa_data.store import schemas

CAMERAS = "CAMERA_01,CAMERA_05,CAMERA_06"


def test_projected_depth_agrees_with_the_derived_one(shared):
    root = shared / "rgbd" / "ddad"
    dataset = ddad(cameras=CAMERAS)
    compared = 0
    for row in dataset.index(root, None).to_pylist():
        _, _, scene, camera, time = row["sample_id"].split("/")
        derived = root / scene / "depth_derived" / camera / f"{time}.png"
        if not derived.is_file():
            continue
        depth = dataset.read_depth(root / row["depth"])
        expected = cv2.imread(str(derived), cv2.IMREAD_UNCHANGED) / 256
        assert depth.shape == expected.shape == (row["height"], row["width"]) == (1216, 1936)
        # Both keep the nearest point of a pixel, so all pixels agree, to the rounding of 1/256 m.
        np.testing.assert_array_equal(depth > 0, expected > 0)
        assert np.abs(depth - expected).max() <= 0.5 / 256 + 1e-5
        compared += 1
    assert compared == 3


ROW = {
    "sample_id": "ddad/train/000/CAM/5",
    "dataset": "ddad",
    "split": "train",
    "scene": "000",
    "image": "000/rgb/CAM/5.png",
    "depth": "000/point_cloud/LIDAR/7.npz#CAM",
    "width": 8,
    "height": 6,
    "fx": 4.0,
    "fy": 4.0,
    "cx": 4.0,
    "cy": 3.0,
}


def test_points_fall_where_the_pinhole_says_and_the_nearest_stays(tmp_path):
    points = [
        [0, 0, 3, 9],  # 2 m ahead: the middle
        [0, 0, 5, 9],  # 4 m ahead, hidden
        [-2, 1, 5, 9],  # u = 4 - 2, v = 3 + 1
        [0, 0, 0.5, 9],  # behind the camera
        [9, 0, 2, 9],  # outside
    ]
    write_scene(tmp_path / "000", points)
    dataset = ddad(cameras="CAM")
    table = dataset.index(tmp_path, None)
    schemas.check("samples", table)
    assert table.to_pylist() == [ROW]
    expected = np.zeros((6, 8), np.float32)
    expected[3, 4], expected[4, 2] = 2, 4
    np.testing.assert_array_equal(dataset.read_depth(tmp_path / ROW["depth"]), expected)


def test_the_pose_turns_as_scipys_rotation(tmp_path):
    from scipy.spatial.transform import Rotation

    from rsa_data.datasets.dgp import read_scene

    turn = Rotation.from_rotvec([0.3, -0.2, 0.9])
    write_scene(tmp_path / "000", [[0, 0, 1, 0]])
    path = tmp_path / "000" / "scene_1.json"
    scene = json.loads(path.read_text())
    x, y, z, w = turn.as_quat()
    scene["data"][1]["datum"]["point_cloud"]["pose"] = pose(1, 2, 3, (w, x, y, z))
    path.write_text(json.dumps(scene))
    expected = np.eye(4)
    expected[:3, :3], expected[:3, 3] = turn.as_matrix(), (1, 2, 2)
    np.testing.assert_allclose(read_scene(path)[0].camera_from_lidar, expected, atol=1e-12)


def test_splits_of_ddad_json(tmp_path):
    for number, folder in enumerate(("000", "150", "200")):
        write_scene(tmp_path / folder, [[0, 0, 3 + number, 0]])
    names = {str(i): {"filenames": [f"{f}/scene_1.json"]} for i, f in enumerate(("000", "150"))}
    (tmp_path / "ddad.json").write_text(json.dumps({"scene_splits": names}))
    dataset = ddad(cameras="CAM")
    assert dataset.index(tmp_path, None)["sample_id"].to_pylist() == [
        "ddad/train/000/CAM/5",
        "ddad/val/150/CAM/5",
    ]
    assert dataset.test_splits == ("val", "test")
    names["0"] = {"filenames": ["../scene_1.json"]}
    (tmp_path / "ddad.json").write_text(json.dumps({"scene_splits": names}))
    with pytest.raises(RsaDataError, match=r"ddad.json: expected a path below the dataset's root"):
        dataset.index(tmp_path, None)


def test_what_is_wrong_is_said(tmp_path):
    with pytest.raises(RsaDataError, match="expected images of any split, found none"):
        ddad().index(tmp_path, None)
    write_scene(tmp_path / "000", [[0, 0, 3, 0]])
    with pytest.raises(RsaDataError, match="expected cameras among CAM, found CAMERA_01"):
        ddad().index(tmp_path, None)
    with pytest.raises(RowError, match=r"expected CAM_2 with point_cloud/LIDAR/7\.npz in scene_"):
        ddad().read_depth(tmp_path / "000/point_cloud/LIDAR/7.npz#CAM_2")
    (tmp_path / "000/point_cloud/LIDAR/7.npz").write_bytes(b"PK\x03\x04 broken")
    with pytest.raises(RowError, match="depth: unreadable point cloud") as caught:
        ddad().read_depth(tmp_path / ROW["depth"])
    assert str(tmp_path) not in str(caught.value)
    (tmp_path / "000/point_cloud/LIDAR/7.npz").unlink()
    with pytest.raises(RowError, match="no such file"):
        ddad().read_depth(tmp_path / ROW["depth"])


def test_distorted_cameras_are_refused(tmp_path):
    write_scene(tmp_path / "000", [[0, 0, 3, 0]], k1=0.1)
    with pytest.raises(RsaDataError, match=r"scene_1.json: .* a camera CAM with distortion \(k1\)"):
        ddad(cameras="CAM").index(tmp_path, None)


@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_damaged_scene_is_refused_by_name(tmp_path, data):
    folder = Path(tempfile.mkdtemp(dir=tmp_path))
    write_scene(folder / "000", [[0, 0, 3, 0]])
    which = data.draw(st.sampled_from(["scene_1.json", "calibration/c.json"]))
    text = (folder / "000" / which).read_text()
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 20)))
    damage = data.draw(st.text("0123456789{}[]\",:.eE-nulinfNaN '", max_size=5))
    (folder / "000" / which).write_text(text[:start] + damage + text[end:])
    try:
        table = ddad(cameras="CAM").index(folder, None)
    except RsaDataError as error:
        assert str(folder) in str(error)
    else:
        schemas.check("samples", table)
