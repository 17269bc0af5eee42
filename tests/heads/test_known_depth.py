"""What is known besides the words: corrections of a head, fits without one, smoothing."""

import numpy as np
import pytest
import scipy.optimize

from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.heads.predict import correction, known_depth


def cost(pair, scale, shift, y, metres, prior, error):
    a, b = pair
    both = prior["correlation"] * prior["scale"] * prior["shift"]
    covariance = np.array([[prior["scale"] ** 2, both], [both, prior["shift"] ** 2]])
    e = np.array([(a - scale) / scale, (b - shift) / shift])
    points = ((a * y + b - 1 / metres) * metres / error) ** 2
    return points.sum() + e @ np.linalg.solve(covariance, e)


@pytest.mark.parametrize("count", [0, 1, 2, 5])
@pytest.mark.parametrize("correlation", [0.0, -0.7])
def test_refine_minimises_its_cost(count, correlation):
    rng = np.random.default_rng(count)
    y, metres = rng.uniform(1, 9, count), rng.uniform(1, 9, count)
    prior = {"scale": 0.2, "shift": 0.4, "correlation": correlation}
    found = correction.refine(0.03, 0.2, y, metres, prior, 0.1)
    best = scipy.optimize.minimize(
        cost,
        (0.03, 0.2),
        (0.03, 0.2, y, metres, prior, 0.1),
        bounds=[(0, None)] * 2,
        method="L-BFGS-B",
        options={"ftol": 1e-15, "gtol": 1e-10},
    )
    at = cost(found, 0.03, 0.2, y, metres, prior, 0.1)
    assert at <= best.fun * (1 + 1e-6) + 1e-12
    if count == 0:
        np.testing.assert_allclose(found, (0.03, 0.2), rtol=1e-9)


def test_more_points_help_more():
    rng = np.random.default_rng(0)
    true_scale, true_shift = 0.05, 0.15
    errors = []
    for count in (0, 1, 2, 5, 50):
        y = rng.uniform(0, 10, count)
        found = correction.refine(0.09, 0.08, y, 1 / (true_scale * y + true_shift))
        grid = np.linspace(0, 10, 50)
        true = 1 / (true_scale * grid + true_shift)
        errors.append(np.mean(np.abs(1 / (found[0] * grid + found[1]) - true) / true))
    assert errors == sorted(errors, reverse=True) and errors[-1] < 0.01


def test_a_range_uses_the_ends_of_the_map():
    y = np.linspace(0, 10, 1001).reshape(7, 143).astype(np.float32)
    y[0, 0] = np.nan
    at, metres = known_depth.ends(y, "1.5,6")
    np.testing.assert_allclose(at, [9.9, 0.1], atol=0.02)
    assert metres.tolist() == [1.5, 6.0]


def test_smoothing_is_a_geometric_mean_of_the_frames_around():
    found = known_depth.smooth(np.array([1.0, 4.0, 16.0, 1.0]), 3)
    np.testing.assert_allclose(found, [2, 4, 4, 4], rtol=1e-6)


@pytest.mark.parametrize("count", [2, 3, 4, 8])
def test_a_fit_is_least_squares_in_relative_inverse_depth(count):
    rng = np.random.default_rng(count)
    metres = rng.uniform(1, 9, count)
    y = 5 * (1 / metres - 0.02) * rng.uniform(0.98, 1.02, count)
    found = known_depth.fit(y, metres)

    def cost(pair):
        return ((pair[0] * y + pair[1]) * metres - 1) @ ((pair[0] * y + pair[1]) * metres - 1)

    best = scipy.optimize.minimize(cost, (0.2, 0.0), method="BFGS", options={"gtol": 1e-12})
    assert cost((found.scale, found.shift)) <= best.fun * (1 + 1e-9) + 1e-15
    assert found.used.all()
    np.testing.assert_allclose(
        found.residuals, 1 / (found.scale * y + found.shift) / metres - 1, rtol=1e-9
    )


@pytest.mark.parametrize("wrong", range(5))
@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_one_wrong_point_among_five_is_left_out(wrong, factor):
    metres = np.array([1.0, 2.0, 3.0, 5.0, 8.0])
    y = 4 * (1 / metres - 0.05)
    told = metres.copy()
    told[wrong] *= factor
    found = known_depth.fit(y, told)
    assert found.used.tolist() == [k != wrong for k in range(5)]
    assert (found.scale, found.shift) == pytest.approx((0.25, 0.05), rel=1e-9)


def test_points_that_contradict_the_relative_depth_are_refused():
    with pytest.raises(RsaDataError, match="expected the relative depth y to be larger at nearer"):
        known_depth.fit(np.array([1.0, 2.0]), np.array([1.0, 3.0]))
    with pytest.raises(RsaDataError, match="the same at all points"):
        known_depth.fit(np.array([1.0, 1.0]), np.array([1.0, 3.0]))


def test_points_that_agree_on_the_opposite_of_relative_depth_are_not_followed():
    """Three on a line that falls: the pairs that rise decide, and all four stay."""
    y, inverse = np.array([1.0, 2.0, 3.0, 8.0]), np.array([0.30, 0.28, 0.26, 0.50])
    found = known_depth.fit(y, 1 / inverse)
    assert found.used.all()
    # Least squares of a y z + b z = 1.
    matrix = np.stack([y, np.ones(4)], 1) / inverse[:, None]
    expected = np.linalg.lstsq(matrix, np.ones(4), rcond=None)[0]
    assert (found.scale, found.shift) == pytest.approx(tuple(expected)) and found.scale > 0


def test_points_where_y_is_not_defined_are_refused():
    y = np.array([[1.0, np.nan]], np.float32)
    with pytest.raises(UsageError, match=r"nothing there; .* is 0,0; all lie in columns 0 to 0"):
        known_depth.points(y, ["1,0,2"])
    y = np.full((9, 9), np.nan, np.float32)
    y[2:4, 5:8] = 1
    with pytest.raises(UsageError, match=r"is 5,3; all lie in columns 5 to 7 and rows 2 to 3$"):
        known_depth.points(y, ["0,8,2"])
    with pytest.raises(UsageError, match=r"the nearest with a depth is 7,3;"):
        known_depth.points(y, ["8,8,2"])


def test_points_are_pixels_of_the_photo_that_the_map_is_of():
    y = np.arange(6, dtype=np.float32).reshape(2, 3)
    at, metres = known_depth.points(y, ["299,150,2"], size=(300, 200))
    assert (at.tolist(), metres.tolist()) == ([5.0], [2.0])


def test_known_points_reach_the_first_and_the_last_pixel_and_no_further():
    y = np.arange(1, 7, dtype=np.float32).reshape(2, 3)
    at, metres = known_depth.points(y, ["0,0,1", "2,1,2.5", "2.9,0,3"])
    assert (at.tolist(), metres.tolist()) == ([1.0, 6.0, 3.0], [1.0, 2.5, 3.0])
    for outside in ("3,0,1", "0,2,1", "-0.1,0,1", "0,-1,1"):
        with pytest.raises(UsageError, match="expected a pixel of the relative depth, 3 x 2"):
            known_depth.points(y, [outside])
    with pytest.raises(UsageError, match="expected a pixel of the photo, 300 x 200"):
        known_depth.points(y, ["300,0,1"], size=(300, 200))


def test_one_point_gives_the_scale_alone():
    found = known_depth.fit(np.array([4.0]), np.array([2.5]))
    assert (found.scale, found.shift) == (pytest.approx(0.1), 0.0)
    assert (found.used.tolist(), found.residuals.tolist()) == ([True], [0.0])
    with pytest.raises(RsaDataError, match="one point alone needs one above 0"):
        known_depth.fit(np.array([0.0]), np.array([2.5]))


@pytest.mark.parametrize("zero", ["scale", "shift"])
def test_neither_scale_nor_shift_becomes_negative(zero):
    y = np.array([1.0, 2.0, 4.0, 8.0])
    # Inverse depth that falls with y, and one that rises from below 0.
    inverse = 0.9 - 0.1 * y if zero == "scale" else 0.2 * y - 0.15
    prior = {"scale": 5.0, "shift": 5.0, "correlation": 0.0}
    arguments = 0.03, 0.2, y, 1 / inverse, prior, 0.1
    found = correction.refine(*arguments)
    assert found[0 if zero == "scale" else 1] == 0
    best = scipy.optimize.minimize(
        cost, (0.03, 0.2), arguments, bounds=[(0, None)] * 2, method="L-BFGS-B",
        options={"ftol": 1e-15, "gtol": 1e-10},
    )  # fmt: skip
    assert cost(found, *arguments) <= best.fun * (1 + 1e-6)


def test_a_fit_whose_shift_is_held_at_0():
    y, metres = np.array([1.0, 2.0, 4.0]), np.array([4.2, 1.9, 7.0])
    found = known_depth.Fit(9.0, 9.0, np.zeros(3), np.array([True, True, False]))
    found = known_depth.without_shift(found, y, metres, "why")
    # Of two points: the scale that misses both by the same factor.
    assert found.scale == pytest.approx(1 / np.sqrt(4.2 * 3.8))
    assert (found.shift, found.assumption, found.used.tolist()) == (0, "why", [True, True, False])
    np.testing.assert_allclose(found.residuals, 1 / (found.scale * y) / metres - 1)


@pytest.mark.parametrize("wrong", range(3))
@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_one_wrong_point_of_three_with_the_shift_held_at_0(wrong, factor):
    y, metres = np.array([1.0, 2.0, 4.0]), np.array([8.0, 4.0, 2.0])
    metres[wrong] *= factor
    found = known_depth.Fit(9.0, 9.0, np.zeros(3), np.ones(3, bool))
    found = known_depth.without_shift(found, y, metres, "why")
    assert found.scale == pytest.approx(1 / 8)
    assert found.used.tolist() == [k != wrong for k in range(3)]


@pytest.mark.parametrize("wrong", [None, 0, 1, 2, 3, 4])
@pytest.mark.parametrize("count", [3, 5])
def test_a_head_is_not_moved_by_one_wrong_point(count, wrong):
    rng = np.random.default_rng(count)
    y = np.linspace(1, 9, count)
    metres = 1 / (0.05 * y + 0.1) * rng.uniform(0.98, 1.02, count)
    right = np.arange(count) != (count if wrong is None else wrong % count)
    told = np.where(right, metres, 9 * metres)
    scale, shift, used = correction.correct(0.06, 0.11, y, told)
    assert used.tolist() == right.tolist()
    assert (scale, shift) == correction.refine(0.06, 0.11, y[right], metres[right])
    # Distances that agree are believed, however far off the head is.
    scale, shift, used = correction.correct(0.3, 0.6, y, metres)
    assert used.all() and (scale, shift) == correction.refine(0.3, 0.6, y, metres)


def test_two_points_that_contradict_the_relative_depth_and_a_head():
    """The one that suits the head stays; the scale does not become 0, which would be a flat map."""
    y, metres = np.array([2.0, 2.2]), np.array([1.4, 2.1])
    scale, _, used = correction.correct(0.3, 0.1, y, metres)
    assert used.tolist() == [True, False] and scale > 0.2
