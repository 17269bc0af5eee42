"""Oracles and constants against SciPy, on random images and on real frames."""

import cv2
import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st
from made_tables import write

from rsa_data.depth.measure import at_size
from rsa_data.depth.onnx import build
from rsa_data.evaluation import constants, oracles
from rsa_data.store.tables import WorkDir


def of_scipy(y, gt, max_depth, start):
    """The same least squares in depth by SciPy's trust region, started from `start`."""

    def residual(p):
        inverse = p[0] * y + p[1]
        return np.where(inverse > 1 / max_depth, 1 / inverse, max_depth) - gt

    with np.errstate(divide="ignore"):
        found = scipy.optimize.least_squares(
            residual, start, x_scale="jac", ftol=1e-15, xtol=1e-15, gtol=1e-15, max_nfev=500
        )
    return found.x, 2 * found.cost


def cost(y, gt, max_depth, fit):
    return np.sum((np.minimum(oracles.metric(y, *fit), max_depth) - gt) ** 2)


@settings(deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([10.0, 80.0]))
def test_least_squares_in_depth_equals_scipy(seed, max_depth):
    rng = np.random.default_rng(seed)
    y = rng.gamma(3, 2, 400)
    gt = 1 / (0.02 * y + 1.5 / max_depth) * np.exp(rng.normal(0, 0.1, 400))
    gt = np.minimum(gt, max_depth * 0.999)
    found = oracles.depth_least_squares(y, gt, max_depth)
    expected, least = of_scipy(y, gt, max_depth, oracles.inverse_least_squares(y, gt))
    assert cost(y, gt, max_depth, found) <= least * (1 + 1e-9)
    assert found == pytest.approx(expected, rel=1e-5)


def test_least_squares_in_depth_begins_from_the_better_fit():
    """Where the two begin in other valleys; found by drawing, and searched from both by SciPy."""
    rng = np.random.default_rng(0)
    apart = 0
    for _ in range(200):
        y, gt = rng.normal(2, 1, 12), rng.uniform(0.5, 9, 12)
        starts = [fit(y, gt) for fit in (oracles.inverse_least_squares, oracles.median)]
        better = min(starts, key=lambda fit: cost(y, gt, 10, fit))
        found = cost(y, gt, 10, oracles.depth_least_squares(y, gt, 10))
        assert found <= cost(y, gt, 10, better) * (1 + 1e-12)
        apart += cost(y, gt, 10, starts[0]) > cost(y, gt, 10, starts[1])
    assert 20 < apart < 180


@given(st.integers(0, 2**32))
@settings(deadline=None)
def test_least_squares_in_depth_is_never_worse_than_the_other_fits(seed):
    rng = np.random.default_rng(seed)
    y, gt = rng.normal(2, 1, 50), rng.uniform(0.5, 9, 50)
    found = cost(y, gt, 10, oracles.depth_least_squares(y, gt, 10))
    for other in (oracles.inverse_least_squares, oracles.median):
        assert found <= cost(y, gt, 10, other(y, gt)) * (1 + 1e-12)


def test_the_median_oracle_matches_the_medians():
    y, gt = np.array([1.0, 2.0, 4.0]), np.array([6.0, 3.0, 2.0])
    scale, shift = oracles.median(y, gt)
    assert np.median(oracles.metric(y, scale, shift)) == np.median(gt)
    assert shift == 0


def test_not_positive_means_beyond_everything():
    depth = oracles.metric(np.array([-1.0, 0.0, 1.0]), 0.5, 0.0)
    assert depth.tolist() == [np.inf, np.inf, 2.0]


def test_a_constant_is_found_again():
    rng = np.random.default_rng(0)
    groups = []
    for scale, low, high in ((1, 0.05, 0.6), (1, 0.05, 3)):
        y = rng.uniform(low, high, 4000)
        groups.append((y, 1 / (0.4 * scale * y + 0.07), 80.0))
    assert constants.fit_constant(groups) == pytest.approx((0.4, 0.07), rel=1e-4)


def test_a_constant_is_the_weighted_median_where_y_tells_nothing():
    """The least sum of |d - z| / z over z is at their median weighted by 1 / z; L1's at theirs."""
    group = (np.zeros(3), np.array([1.0, 3.0, 3.1]), 80.0)
    assert 1 / constants.fit_constant([group])[1] == pytest.approx(1, rel=1e-4)
    assert 1 / constants.fit_constant([group], relative=False)[1] == pytest.approx(3, rel=1e-4)


def test_pixels_of_a_constant_are_spread_over_all_parts(tmp_path):
    """12 images in parts of 5: of 4 the 1st, 4th, 8th and 12th, and the first 2 pixels of each."""
    work, y = WorkDir(tmp_path), np.arange(36.0).reshape(12, 3)
    write(
        work, "nyuv2", scenes=["a"] * 12, texts=[["a"]] * 12, features={"a": np.zeros(4)},
        relative=y, metric=y + 100, part=5,
    )  # fmt: skip
    found = constants.training_pixels(work, "nyuv2", "depth/files", images=4, pixels=2)
    np.testing.assert_array_equal(found[0], y[[0, 3, 7, 11], :2].ravel())
    np.testing.assert_array_equal(found[1], found[0] + 100)


@pytest.mark.parametrize("asked", [{}, {"relative": False}], ids=["AbsRel", "L1"])
def test_a_constant_is_as_good_as_a_search_by_scipy(asked):
    rng = np.random.default_rng(1)
    y = rng.beta(0.8, 2, 5000) * 15
    d = np.minimum(1 / (0.05 * y + 0.03) * np.exp(rng.normal(0, 0.6, 5000)), 80)
    over = 1.0 if asked else d

    def loss(p):
        errors = np.abs(np.minimum(1 / (np.exp(p[0]) * y + np.exp(p[1])), 80.0) - d)
        return np.mean(errors / over)

    searched = scipy.optimize.differential_evolution(loss, [(-8, 2), (-8, 2)], seed=0)
    ours = constants.fit_constant([(y, d, 80.0)], **asked)
    assert loss(np.log(ours)) <= searched.fun * (1 + 1e-4)


FRAMES = {
    "nyu": ("nyuv2/rgb_00000.jpg", "nyuv2/sync_depth_00000.png", 1000, 10),
    "kitti": ("kitti/0000000005.png", "kitti/0000000005_depth.png", 256, 80),
    **{
        f"7scenes-{n}": (
            f"7scenes/frame-{n:06d}.color.jpg",
            f"7scenes/frame-{n:06d}.depth.png",
            1000,
            10,
        )
        for n in (0, 330, 990)
    },
}


@pytest.mark.parametrize(("image", "depth", "unit", "far"), FRAMES.values(), ids=FRAMES)
def test_oracles_on_real_frames_equal_scipy(shared, image, depth, unit, far):
    root = shared / "rgbd"
    source = build(
        name="tu2020",
        root=root,
        weights=shared / "models" / "tu2020_mbv2_blconv7dw_nyu_224.onnx",
        geometry=None,
        crop="none",
        threads=1,
    )
    gt = cv2.imread(str(root / depth), cv2.IMREAD_UNCHANGED).astype(np.float64) / unit
    y = at_size(source(image), *gt.shape)
    valid = (gt > 1e-3) & (gt < far) & ~np.isnan(y)
    y, gt = y[valid].astype(np.float64), gt[valid]
    assert len(y) > 5000

    design = np.stack([y, np.ones_like(y)], 1)
    linear = scipy.linalg.lstsq(design, 1 / gt)[0]
    assert oracles.inverse_least_squares(y, gt) == pytest.approx(linear, rel=1e-6)

    found = oracles.depth_least_squares(y, gt, far)
    expected, least = of_scipy(y, gt, far, found)
    assert found == pytest.approx(expected, rel=1e-6)
    from_elsewhere = of_scipy(y, gt, far, linear)[1]
    assert cost(y, gt, far, found) <= min(least, from_elsewhere) * (1 + 1e-9)
