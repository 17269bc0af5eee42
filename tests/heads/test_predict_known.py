"""Known distances in predict: with a head and without, right and contradicting."""

import cv2
import numpy as np
import pytest
from predicting import predict, run

from rsa_data.store.tables import WorkDir


def test_known_distances_need_no_head_and_no_work_dir(tmp_path, monkeypatch):
    """y of another scale and shift, exact: three points give the depth everywhere, one a scale."""
    monkeypatch.chdir(tmp_path)
    truth = np.random.default_rng(0).uniform(0.5, 9, (30, 40)).astype(np.float32)
    np.save("y.npy", (1 / truth - 0.03) * 17)
    points = [f"{u},{v},{truth[v, u]}" for u, v in ((3, 2), (20, 25), (39, 29))]
    words = [word for point in points for word in ("--known", point)]
    work = WorkDir(tmp_path / "none")
    done = run(work, "--relative", "y.npy", *words, "--out", "d.npy")
    assert done.exit_code == 0, done.output
    np.testing.assert_allclose(np.load("d.npy"), truth, rtol=0.01)
    assert not (tmp_path / "none").exists()
    (p,) = predict(work, relative=tmp_path / "y.npy", known=points[:1])
    assert p.depth[2, 3] == pytest.approx(truth[2, 3], rel=1e-5) and p.shift == 0
    assert "the shift is assumed to be 0" in p.warnings[0]


def test_a_shift_below_0_that_would_leave_pixels_without_depth_is_held_at_0(tmp_path):
    """1 / z = 0.2 y - 0.3 at two points, exactly: below 0 where y < 1.5."""
    y = np.linspace(0.5, 4, 48).reshape(6, 8).astype(np.float32)
    np.save(tmp_path / "y.npy", y)
    points = [(7, 5), (0, 4)]
    known = [f"{u},{v},{1 / (0.2 * y[v, u] - 0.3)}" for u, v in points]
    (p,) = predict(WorkDir(tmp_path / "none"), relative=tmp_path / "y.npy", known=known)
    share = float(np.mean(0.2 * y - 0.3 <= 0))
    assert f"would leave {share:.0%} of the pixels without a finite depth" in p.warnings[0]
    assert p.shift == 0 and np.isfinite(p.depth).all()
    # Where y is 2 or more everywhere, the same points are taken as they are.
    np.save(tmp_path / "y.npy", np.maximum(y, 2))
    (p,) = predict(WorkDir(tmp_path / "none"), relative=tmp_path / "y.npy", known=known)
    assert (p.scale, p.shift) == pytest.approx((0.2, -0.3), rel=1e-4)


def test_a_known_point_pulls_the_prediction_to_it(work, y, tmp_path):
    relative = {"caption": ("a kitchen",), "relative": tmp_path / "y.npy"}
    (words,) = predict(work, **relative)
    before = 1 / (words.scale * y[2, 3] + words.shift)
    (p,) = predict(work, **relative, known=(f"3,2,{2 * before}",))
    after = 1 / (p.scale * y[2, 3] + p.shift)
    assert before < after < 2 * before and after > 1.8 * before
    assert any("from words alone" in note for note in p.notes)
    (known,) = p.known
    assert known.depth == pytest.approx(after)
    assert known.error == pytest.approx(after / 2 / before - 1, abs=1e-5)
    assert f"residuals: {2 * before:g} m {known.error:+.1%}" in p.notes[-1]
    said = p.plain()
    assert said["known"][0] == {
        "u": 3.0, "v": 2.0, "metres": pytest.approx(2 * before), "depth": pytest.approx(after),
        "residual": pytest.approx(known.error, abs=1e-4), "used": True,
    }  # fmt: skip
    assert said["head"] == {
        k: pytest.approx(getattr(words, k), rel=1e-5) for k in ("scale", "shift")
    }
    assert said["camera"]["source"].startswith("assumed") and said["camera"]["fov"] == 65
    assert (said["objects"], said["segmenter"]) == (None, None)


def test_points_that_contradict_each_other_are_doubted(work, y, tmp_path):
    """The two pixels are equally near, the distances are not: a head tells which one is wrong."""
    np.save(tmp_path / "y.npy", np.where(y > 2, np.float32(2), y))
    near = [f"{u},{v}" for v, u in np.argwhere(y > 2)[:2]]
    far = "{1},{0}".format(*np.argwhere(y < 2)[0])
    known = (f"{near[0]},1", f"{near[1]},4", f"{far},4.1")
    agree = (f"{near[0]},1", f"{near[1]},1", f"{far},3")
    for head in ({"caption": ("a kitchen",)}, {}):
        options = {"relative": tmp_path / "y.npy", **head}
        (p,) = predict(work, **options, known=known)
        worst = max(p.known, key=lambda k: abs(k.error))
        u, v = worst.pixel
        name = f"{worst.metres:g} m at {u:g},{v:g}"
        if head:
            (said,) = [w for w in p.warnings if "and the head were left out" in w]
            assert name in said and [k.used for k in p.known].count(False) == 1
        else:
            (said,) = [w for w in p.warnings if "do not agree with the relative depth" in w]
            assert f"{name} by {abs(worst.error):.0%}" in said and "misses " in said
        if head:
            (p,) = predict(work, **options)
            u, v = map(int, near[0].split(","))
            agree = (f"{near[0]},{p.depth[v, u]}",)
        (p,) = predict(work, **options, known=agree)
        assert not any("do not agree" in w for w in p.warnings)


def test_one_wrong_point_among_five_is_left_out_with_a_head_too(work, tmp_path):
    y = np.linspace(0.2, 1, 48, dtype=np.float32).reshape(6, 8)
    np.save(tmp_path / "y.npy", y)
    options = {"caption": ("a kitchen",), "relative": tmp_path / "y.npy"}
    (plain,) = predict(work, **options)
    right = [f"{u},{v},{1.1 * plain.depth[v, u]}" for u, v in ((0, 0), (3, 1), (5, 3), (7, 5))]
    (p,) = predict(work, **options, known=(*right, f"4,4,{3 * plain.depth[4, 4]}"))
    (only,) = predict(work, **options, known=right)
    assert [k.used for k in p.known] == [True] * 4 + [False]
    assert (p.scale, p.shift) == (only.scale, only.shift) != (plain.scale, plain.shift)
    assert "(left out)" in p.notes[-1] and not any("do not agree" in w for w in p.warnings)
    assert any("bear it out" in w for w in p.all_warnings)


def test_a_distance_in_millimetres_is_asked_about(y, tmp_path):
    for metres, asked in (("2184", True), ("2.184", False)):
        given = {"relative": tmp_path / "y.npy", "known": (f"1,1,{metres}",)}
        (p,) = predict(WorkDir(tmp_path / "none"), **given)
        assert any(f"{metres} m at 1,1; are they in metres?" in w for w in p.warnings) == asked


def test_known_points_of_several_photos_are_warned_about(tmp_path):
    (tmp_path / "maps").mkdir()
    for name in ("a", "b"):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.zeros((6, 8, 3), np.uint8))
        np.save(tmp_path / f"maps/{name}.npy", np.full((6, 8), 0.5, np.float32))
    photos, work = [tmp_path / "a.png", tmp_path / "b.png"], WorkDir(tmp_path / "none")
    for given, count in ((photos, 2), (photos[:1], 0)):
        found = predict(work, *given, relative=tmp_path / "maps", known=("1,1,2",))
        assert sum(any("in all 2 photos" in w for w in p.warnings) for p in found) == count
