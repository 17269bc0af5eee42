"""Metric depth as files, read again by other programs."""

import io

import cv2
import numpy as np
import pytest

from rsa_data.common.errors import UsageError
from rsa_data.heads.predict.camera import Camera
from rsa_data.heads.predict.prediction import Prediction
from rsa_data.views.depth_files import maps, space
from rsa_data.views.depth_files.write import Outputs, Writer


def test_png_holds_millimetres():
    data = maps.png(np.array([[1.2344, np.inf], [np.nan, 70.0]], np.float32))
    depth = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(depth, np.array([[1234, 65535], [0, 65535]], np.uint16))


def test_ply_holds_points_in_front_of_the_camera():
    trimesh = pytest.importorskip("trimesh")
    depth = np.array([[2.0, np.inf], [np.nan, 4.0]], np.float32)
    colours = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    data = space.ply(depth, (2.0, 4.0, 0.5, 0.5), colours)
    cloud = trimesh.load(io.BytesIO(data.data), file_type="ply")
    assert data.told == "2 points; 2 pixels without a depth left out (50%)"
    np.testing.assert_allclose(cloud.vertices, [[-0.5, -0.25, 2.0], [1.0, 0.5, 4.0]])
    assert cloud.colors[:, :3].tolist() == [[0, 1, 2], [9, 10, 11]]


def test_glb_is_a_textured_mesh_cut_where_the_depth_jumps():
    """A wall at 2 m and one at 4 m, side by side: two surfaces with nothing between them."""
    trimesh = pytest.importorskip("trimesh")
    depth = np.full((20, 30), 2.0, np.float32)
    depth[:, 15:] = 4.0
    photo = np.zeros((20, 30, 3), np.uint8)
    photo[:, 15:] = 255
    data = space.glb(depth, (30.0, 30.0, 15.0, 10.0), photo)
    assert data.told == (
        "1,064 triangles; 0 pixels without a depth left out (0%); cut at 38 triangles whose depth "
        "jumps by more than 8%"
    )
    assert (
        "one pixel of 2 x 2 taken, for at most 200 points"
        in space.ply(depth, (30, 30, 15, 10), most=200).told
    )
    scene = trimesh.load(io.BytesIO(data.data), file_type="glb")
    (mesh,) = scene.geometry.values()
    assert sorted({round(float(z), 3) for z in mesh.vertices[:, 2]}) == [-4.0, -2.0]
    assert len(mesh.faces) == 2 * 19 * (14 + 14)
    left = mesh.vertices[mesh.vertices[:, 2] > -3]
    np.testing.assert_allclose(left[:, 0].min(), (0 - 15) / 30 * 2)
    np.testing.assert_allclose(left[:, 1].max(), (10 - 0) / 30 * 2)  # y is up
    texture = np.asarray(mesh.visual.material.baseColorTexture.convert("RGB"))
    np.testing.assert_array_equal(texture, photo)
    # Where a vertex looks into the texture: the white half belongs to the far wall.
    white = mesh.visual.uv[:, 0] > 0.5
    np.testing.assert_array_equal(white, mesh.vertices[:, 2] < -3)


def test_colours_have_a_bar_beside_the_map():
    depth = np.linspace(1, 5, 200 * 300, dtype=np.float32).reshape(200, 300)
    picture = maps.coloured(depth)
    assert picture.shape[0] == 200 and picture.shape[1] > 300
    bar = picture[20:150, 300 + 17]
    assert len({tuple(c) for c in bar.tolist()}) > 50
    # Near is dark, far is bright, in the map and in the bar.
    assert picture[2, 2].sum() < picture[-2, 298].sum() and bar[-1].sum() < bar[0].sum()


def prediction(name):
    camera = Camera(10, 10, 2, 2, 4, 4, "test")
    depth = np.full((4, 4), 2.0, np.float32)
    return Prediction(None, 1, 0, name, depth=depth, image=np.zeros((4, 4, 3), np.uint8),
                      camera=camera)  # fmt: skip


def test_names_of_files(tmp_path):
    p = prediction("a.b/c.jpg")
    Writer(Outputs(tmp_path, colours=True, ply=True, glb=True)).write(p)
    names = sorted(f.relative_to(tmp_path).as_posix() for f in p.files)
    assert names == ["a.b/c-colours.png", "a.b/c.glb", "a.b/c.npy", "a.b/c.ply"]
    assert sorted(f for f in tmp_path.rglob("*") if f.is_file()) == sorted(p.files)
    p = prediction("c.jpg")
    Writer(Outputs(tmp_path / "x.png", colours=True)).write(p)
    assert [f.name for f in p.files] == ["x.png", "x-colours.png"]


def test_one_file_is_not_written_twice(tmp_path):
    writer = Writer(Outputs(tmp_path / "x.npy"))
    writer.write(prediction("a.jpg"))
    with pytest.raises(UsageError, match="one file for several photos"):
        writer.write(prediction("b.jpg"))
