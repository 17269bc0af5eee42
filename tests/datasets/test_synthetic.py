"""Synthetic datasets: the ray caster against SciPy, true sizes, files that survive a kill."""

import itertools
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.stats import linregress, spearmanr

import rsa_data.datasets.synthetic
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.datasets.index import open_dataset
from rsa_data.datasets.synthetic.builder import categories
from rsa_data.datasets.synthetic.dataset import synthetic_indoor, synthetic_street
from rsa_data.datasets.synthetic.relative import FACTOR
from rsa_data.datasets.synthetic.render import cast
from rsa_data.datasets.synthetic.scenes import INDOOR, STREET, shoot
from rsa_data.datasets.synthetic.sizes import SIZES
from rsa_data.datasets.synthetic.solids import BOX, ELLIPSOID, GABLE, Camera, Solid
from rsa_data.depth import files as depth_files
from rsa_data.segments import coco_panoptic
from rsa_data.store import schemas

BUILDERS = [synthetic_indoor, synthetic_street]
SMALL = {"scenes": 3, "test_scenes": 2}


def solid(shape, centre, half, yaw=0.0):
    return Solid(shape, centre, half, yaw, (0.5, 0.5, 0.5), "", 1)


def corners(body):
    """The vertices of a box, or of a gable whose ridge runs along its x axis."""
    tops = ([0] if body.shape == GABLE else [-1, 1], [1])
    unit = [*itertools.product([-1, 1], [-1, 1], [-1]), *itertools.product([-1, 1], *tops)]
    c, s = np.cos(body.yaw), np.sin(body.yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return np.array(unit) * body.half @ turn.T + body.centre


def way_to_hull(points, origin, ray):
    """Depth at which a ray enters a convex hull, by linear programming; inf when it misses."""
    planes = ConvexHull(points).equations
    found = linprog(
        [1.0],
        A_ub=planes[:, :3] @ ray[:, None],
        b_ub=-planes[:, 3] - planes[:, :3] @ origin,
        bounds=[(0, None)],
    )
    return found.x[0] if found.status == 0 else np.inf


@pytest.mark.parametrize("shape", [BOX, GABLE])
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_flat_bodies_stand_where_linear_programming_finds_them(shape, yaw):
    body = solid(shape, (0.4, 6.0, 1.0), (1.2, 0.8, 0.7), yaw)
    camera = Camera((-0.3, 0.2, 1.5), 0.1, -0.1, 40.0, 40, 30)
    found = cast([body], camera).depth
    right, down, forward = camera.axes()
    for row, column in itertools.product(range(0, 30, 3), range(0, 40, 4)):
        ray = forward + right * (column + 0.5 - 20) / 40 + down * (row + 0.5 - 15) / 40
        expected = way_to_hull(corners(body), np.array(camera.position), ray)
        assert found[row, column] == pytest.approx(expected, rel=1e-4)
    assert np.isfinite(found).sum() > 100


def test_a_sphere_has_the_depth_and_size_of_the_closed_form():
    view = cast([solid(ELLIPSOID, (0, 5, 0), (1, 1, 1))], Camera((0, 0, 0), 0, 0, 400.0, 401, 401))
    assert view.depth[200, 200] == pytest.approx(4.0, rel=1e-5)
    # Seen from distance d, a sphere of radius r fills a disc of radius f r / sqrt(d^2 - r^2).
    assert np.isfinite(view.depth).sum() == pytest.approx(np.pi * 400**2 / 24, rel=0.01)


def test_the_nearer_body_hides_the_farther_and_what_is_behind_the_camera_is_not_seen():
    near = solid(BOX, (0, 3, 0), (0.5, 0.5, 0.5))._replace(segment=2)
    far, behind = solid(BOX, (0, 8, 0), (9, 0.5, 9)), solid(BOX, (0, -3, 0), (0.5, 0.5, 0.5))
    view = cast([near, far, behind], Camera((0, 0, 0), 0, 0, 20.0, 21, 21))
    assert (view.segments[10, 10], view.depth[10, 10]) == (2, pytest.approx(2.5))
    assert (view.segments[0, 0], view.depth[0, 0]) == (1, pytest.approx(7.5))
    assert set(np.unique(view.segments)) == {1, 2}


@pytest.mark.parametrize("world", [INDOOR, STREET], ids=["indoor", "street"])
def test_a_scene_follows_from_its_key_alone(world):
    first, again, other = (shoot(world, key, 2) for key in ((0, 0, 1), (0, 0, 1), (1, 0, 1)))
    for a, b in zip(first, again, strict=True):
        for name in ("image", "depth", "relative", "segments"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert (a.labels, a.camera) == (b.labels, b.camera)
    assert not np.array_equal(first[0].image, other[0].image)
    assert not np.array_equal(first[0].image, first[1].image)


@pytest.fixture(scope="module")
def shots():
    return [s for world in (INDOOR, STREET) for k in range(16) for s in shoot(world, (5, 0, k), 1)]


def test_relative_depth_is_affine_in_inverse_depth_up_to_a_mild_error(shots):
    for shot in shots:
        there = np.isfinite(shot.depth)
        fit = linregress(shot.relative[there], 1 / shot.depth[there])
        assert fit.rvalue > 0.98
        assert fit.slope > 0
        assert shot.relative.min() >= 0
        assert not shot.relative[~there].size or np.median(shot.relative[~there]) < 0.05


def test_relative_depth_is_in_units_of_the_images_own_content(shots):
    """The same spread whatever the extent: only the fit's scale and shift tell it."""
    median, intercept = [], []
    for shot in shots:
        y, depth = (a[np.isfinite(shot.depth)] for a in (shot.relative, shot.depth))
        assert np.abs(y - np.median(y)).mean() == pytest.approx(FACTOR, rel=0.12)
        median.append(np.median(depth))
        intercept.append(linregress(y, 1 / depth).intercept)
    assert max(median) > 8 * min(median)
    assert spearmanr(median, intercept).statistic < -0.8


def test_people_and_cars_are_as_tall_as_people_and_cars(shots):
    """Height from depth, as a surveyor would: rows of the segment times depth over focal length."""
    tall = {"person": [], "car": []}
    for shot in shots:
        for k, label in enumerate(shot.labels):
            mask = shot.segments == k + 1
            rows = np.flatnonzero(mask.any(1))
            cut = mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any()
            if label in tall and not cut and abs(shot.camera.pitch) < 0.12:
                height = len(rows) * np.median(shot.depth[mask]) / shot.camera.focal
                tall[label].append(height)
    for label, heights in tall.items():
        assert len(heights) > 5
        # What stands before it hides some of them; none is taller than they come. The median
        # depth of a car is not that of its roof: a fifth more.
        assert np.percentile(heights, 90) == pytest.approx(np.mean(SIZES[label][2]), rel=0.2)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Both datasets on disk: builder -> root. Tests that write take a copy."""
    roots = {build: tmp_path_factory.mktemp(build.__name__) for build in BUILDERS}
    for build, root in roots.items():
        build(**SMALL).prepare(root)
    return roots


@pytest.mark.parametrize("build", BUILDERS, ids=lambda b: b.__name__)
def test_files_are_read_as_those_of_any_dataset(build, written):
    dataset, root = build(**SMALL), written[build]
    samples = dataset.index(root, None)
    schemas.check("samples", samples)
    assert samples["split"].to_pylist() == ["test"] * 4 + ["train"] * 6
    assert samples["scene"].to_pylist()[:4] == ["00000", "00000", "00001", "00001"]
    assert dataset.index(root, "test") == samples.slice(0, 4)
    segments = coco_panoptic.build(argument=None, dataset=dataset, root=root)(samples)
    assert set(segments["status"].to_pylist()) == {"ok"}
    source = depth_files.build(argument="", dataset=dataset, root=root, holds="relative")
    world, number = (INDOOR, 0) if build is synthetic_indoor else (STREET, 1)
    assert world.stream == number
    for sample, found in zip(samples.to_pylist(), segments.to_pylist(), strict=True):
        _, split, key = sample["sample_id"].split("/")
        assert (sample["image"], sample["depth"]) == dataset.key_paths(split, key)
        assert sample["scene"] == dataset.scene(key)
        scene, view = key.split("_")
        made = shoot(world, (0, int(split == "test"), int(scene)), 2)[int(view)]
        assert found["label"] == made.labels
        assert 0.95 < sum(found["area"]) <= 1
        depth = dataset.read_depth(root / sample["depth"])
        known = np.isfinite(made.depth) & (made.depth < 65)
        np.testing.assert_allclose(depth[known], made.depth[known], atol=2.1e-3)
        assert (depth[~np.isfinite(made.depth)] == 0).all()
        np.testing.assert_allclose(source(sample["image"]).y, made.relative, rtol=1e-3, atol=1e-6)


def tree(root):
    """Every visible file below root and its bytes."""
    return {
        str(p.relative_to(root)): p.read_bytes()
        for p in sorted(root.rglob("*"))
        if p.is_file() and not p.name.startswith(".")
    }


def test_what_was_killed_goes_on_to_the_same_bytes(written, tmp_path):
    whole, killed = written[synthetic_indoor], tmp_path / "killed"
    dataset = synthetic_indoor(**SMALL)
    code = (
        "from pathlib import Path\n"
        "from rsa_data.datasets.synthetic.dataset import synthetic_indoor as s\n"
        f"s(**{SMALL}).prepare(Path({str(killed)!r}))"
    )
    package = Path(rsa_data.datasets.synthetic.__file__).parents[3]
    environment = {**os.environ, "PYTHONPATH": str(package)}
    process = subprocess.Popen([sys.executable, "-c", code], env=environment)
    # Scenes render side by side, and one of them is kept when both of its pictures are there.
    whole_scenes = lambda: list(killed.glob("train/records/*_1.json"))  # noqa: E731
    while process.poll() is None and not whole_scenes():
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (killed / "panoptic.json").exists()
    with pytest.raises(RsaDataError, match="renders them"):
        dataset.index(killed, None)
    one = whole_scenes()[0].stem
    there = (killed / f"train/rgb/{one}.png").stat().st_mtime_ns
    dataset.prepare(killed)
    assert tree(killed) == tree(whole)
    assert (killed / f"train/rgb/{one}.png").stat().st_mtime_ns == there


def test_what_is_complete_is_left_alone_and_what_is_lost_is_made_again(written, tmp_path):
    root = shutil.copytree(written[synthetic_street], tmp_path / "street")
    dataset = synthetic_street(**SMALL)
    before = tree(root)
    times = {p: p.stat().st_mtime_ns for p in root.rglob("*")}
    dataset.prepare(root)
    assert {p: p.stat().st_mtime_ns for p in root.rglob("*")} == times
    shutil.rmtree(root / "test")
    (root / "panoptic.json").unlink()
    dataset.prepare(root)
    assert tree(root) == before


def test_scenes_of_another_recipe_and_folders_of_others_are_refused(written, tmp_path):
    root = shutil.copytree(written[synthetic_indoor], tmp_path / "a")
    other = synthetic_indoor(scenes=4, test_scenes=2, seed=7)
    with pytest.raises(RsaDataError, match=r"rendered with scenes = 3, seed = 0, not 4, 7; give"):
        other.prepare(root)
    with pytest.raises(RsaDataError, match="expected rendered scenes, found none"):
        other.index(root, None)
    (root / "recipe.json").write_text("{")
    with pytest.raises(RsaDataError, match="expected JSON"):
        other.prepare(root)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "holiday.jpg").write_bytes(b"")
    with pytest.raises(RsaDataError, match="empty folder or one with its recipe"):
        other.prepare(tmp_path / "b")


@pytest.mark.parametrize(
    "options", [{"scenes": 0}, {"test_scenes": -1}, {"seed": -1}], ids=lambda o: next(iter(o))
)
def test_options_out_of_range_are_refused(options):
    with pytest.raises(UsageError, match=f"synthetic-street: {next(iter(options))}: expected"):
        open_dataset("synthetic-street", options)


def test_no_kind_of_room_or_street_is_told_by_a_name(written):
    kinds = tomllib.loads(
        (Path(rsa_data.datasets.synthetic.__file__).parent / "kinds.toml").read_text()
    )
    for build, root in written.items():
        names = {str(p.relative_to(root)) for p in root.rglob("*")}
        text = " ".join(names) + (root / "panoptic.json").read_text()
        for kind in (*kinds["rooms"], *kinds["streets"]):
            assert kind.replace("_", " ") not in text, build


def test_every_class_is_one_of_cocos(shots):
    used = {label for shot in shots for label in shot.labels}
    assert used <= set(categories())
    assert {"wall", "floor", "chair", "road", "car", "sky", "building", "person"} <= used
