"""What the playground computes, without its page."""

import numpy as np
import pytest

from rsa_data.heads.predict.camera import Camera
from rsa_data.views.playground import desk
from rsa_data.views.playground.rays import rays


def picture(y: np.ndarray) -> desk.Picture:
    height, width = y.shape
    image = np.zeros((height, width, 3), np.uint8)
    camera = Camera(100.0, 100.0, width / 2, height / 2, width, height, "a test")
    return desk.Picture("a", image, None, "An image.", y, "", None, camera)


def test_distance_on_a_wall_is_that_of_its_pixels():
    wall = picture(np.full((100, 200), 4.0, np.float32))
    depth = desk.depth_of(wall, 0.1, 0.1)  # 1 / (0.4 + 0.1) = 2 m
    # 100 columns at a focal length of 100 px, 2 m away.
    assert desk.distance(wall, depth, (50, 50), (150, 50)) == pytest.approx(2.0)


def test_distance_in_depth_is_the_difference_of_depths():
    y = np.ones((100, 200), np.float32)
    y[:, 100:] = 0.25
    scene = picture(y)
    depth = desk.depth_of(scene, 1.0, 0.0)  # 1 m and 4 m
    a, b = (desk.place(scene, depth, u, 50) for u in (99, 100))
    assert b[2] - a[2] == pytest.approx(3)
    assert desk.distance(scene, depth, (99, 50), (100, 50)) == pytest.approx(3, abs=1e-3)


def test_rays_are_the_points_of_the_pixels_with_y_up():
    scene = picture(np.full((60, 80), 0.5, np.float32))
    found = rays(scene)
    points = found.points(1.0, 0.0)
    assert len(points) == len(found.colours) == 60 * 80
    np.testing.assert_allclose(points[:, 2], -2)
    np.testing.assert_allclose(points[0], [-0.8, 0.6, -2], rtol=1e-6)
    np.testing.assert_allclose(found.points(0.5, 0.25), points)  # 1 / (0.5 * 0.5 + 0.25) = 2


def test_what_is_infinitely_far_has_no_point():
    y = np.full((60, 80), 0.5, np.float32)
    y[:30] = -1
    scene = picture(y)
    assert np.isfinite(rays(scene).points(1.0, 0.0)).all(1).sum() == 30 * 80


def test_large_pictures_are_thinned_and_the_farthest_left_out():
    y = np.full((1000, 1500), 0.5, np.float32)
    y[:10] = 0.01
    found = rays(picture(y))
    assert len(found.y) <= 20_000 and found.y.min() == 0.5


def test_colours_of_rays_are_those_of_a_larger_picture():
    y = np.full((40, 60), 0.5, np.float32)
    image = np.zeros((80, 120, 3), np.uint8)
    image[40:] = 255
    camera = Camera(100.0, 100.0, 60.0, 40.0, 120, 80, "a test")
    scene = desk.Picture("a", image, None, "", y, "", None, camera)
    found = rays(scene)
    np.testing.assert_array_equal(found.colours[:, 0], (found.up <= 0).astype(float))


def test_the_view_is_filled_by_the_points_whatever_their_size():
    """Nearly all points are in the frustum, and some near its border, at 1 m as at 100 m."""
    pytest.importorskip("nicegui")
    from rsa_data.views.playground.space import eye

    rng = np.random.default_rng(0)
    shape = rng.uniform((-1, -0.7, -4), (1, 0.7, -2), (500, 3))
    for size in (1, 30):
        points = shape * size
        at = np.array(eye(points))
        low, high = np.percentile(points, [5, 95], axis=0)
        ahead = (low + high) / 2 - at
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, [0, 1, 0])
        right /= np.linalg.norm(right)
        away = points - at
        up = np.abs(away @ np.cross(right, ahead)) / (away @ ahead) / np.tan(np.deg2rad(25))
        across = np.abs(away @ right) / (away @ ahead) / np.tan(np.deg2rad(25)) / 1.1
        worst = np.maximum(up, across)
        assert 0.98 < np.mean(worst <= 1.001) < 1 and worst.max() > 0.9
