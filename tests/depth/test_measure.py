"""The depth stage: sources of y, sampling, fits, quarantined rows."""

from dataclasses import replace

import cv2
import numpy as np
import pyarrow as pa
import pytest
import scipy.stats

from rsa_data.common.errors import RowError, RsaDataError, UsageError
from rsa_data.datasets.dataset import Dataset
from rsa_data.depth import files, onnx
from rsa_data.depth.choice import files as model_files
from rsa_data.depth.measure import STAGE, build
from rsa_data.runner import stages
from rsa_data.store import schemas


def read_millimetres(path):
    values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if values is None:
        raise RowError("not a readable PNG")
    return values.astype(np.float32) / 1000


ROOMS = Dataset("rooms", lambda root, split: None, read_millimetres, min_depth=1e-3, max_depth=10.0)


def samples(*rows):
    """(key, split, image, depth) -> samples."""
    n = len(rows)
    blank = ("width", "height", "fx", "fy", "cx", "cy")
    columns = {
        "sample_id": [f"rooms/{split}/{key}" for key, split, _, _ in rows],
        "dataset": ["rooms"] * n,
        "split": [row[1] for row in rows],
        "scene": ["a"] * n,
        "image": [row[2] for row in rows],
        "depth": [row[3] for row in rows],
    }
    return schemas.from_columns("samples", columns | {name: [None] * n for name in blank})


@pytest.fixture
def rooms(tmp_path):
    """Two frames of 8 x 6 px whose y is exactly (1 / depth - 0.1) / 0.5, three times smaller."""
    rng = np.random.default_rng(0)
    (tmp_path / "y").mkdir()
    for name in ("a", "b"):
        depth = rng.integers(1000, 9000, (6, 8)).astype(np.uint16)
        depth[0] = 0
        cv2.imwrite(str(tmp_path / f"{name}.depth.png"), depth)
        (tmp_path / f"{name}.jpg").write_bytes(b"the files source never opens it")
        with np.errstate(divide="ignore"):
            np.save(tmp_path / "y" / f"{name}.npy", (1000 / depth.astype(np.float64) - 0.1) / 0.5)
        y = np.load(tmp_path / "y" / f"{name}.npy")
        y[0] = np.nan
        np.save(tmp_path / "y" / f"{name}.npy", y)
    return tmp_path


def step(root, **options):
    return build(dataset=ROOMS, root=root, depth_model=f"files:{root}/y", **options)


def test_training_pixels_and_whole_test_maps(rooms):
    rows = samples(
        ("a", "train", "a.jpg", "a.depth.png"),
        ("b", "test", "b.jpg", "b.depth.png"),
        ("c", "train", "c.jpg", None),
    )
    table = step(rooms, pixels=64)(rows)
    schemas.check("depth", table)
    train, test, none = table.to_pylist()

    assert none["status"] == "skipped"
    assert (train["status"], train["kind"], train["n_valid"], train["repeated"]) == (
        "ok",
        "pixels",
        40,
        True,
    )
    y, metric = (np.frombuffer(train[c], "<f2").astype(float) for c in ("relative", "metric"))
    assert len(y) == len(metric) == 64
    assert len(np.unique(np.stack([y, metric]), axis=1)[0]) == 40
    np.testing.assert_allclose(1 / (0.5 * y + 0.1), metric, rtol=2e-3)

    assert (test["kind"], test["width"], test["height"]) == ("map", 8, 6)
    stored = np.frombuffer(test["metric"], "<f2").reshape(6, 8)
    np.testing.assert_array_equal(
        stored, read_millimetres(rooms / "b.depth.png").astype(np.float16)
    )
    assert test["fit_scale"] == pytest.approx(0.5, abs=1e-6)
    assert test["fit_shift"] == pytest.approx(0.1, abs=1e-6)


def test_rows_do_not_depend_on_their_neighbours(rooms):
    a, b = (("a", "train", "a.jpg", "a.depth.png"), ("b", "train", "b.jpg", "b.depth.png"))
    run = step(rooms, pixels=16)
    both = run(samples(a, b))
    assert both.equals(pa.concat_tables([run(samples(a)), run(samples(b))]))
    assert not both.equals(step(rooms, pixels=16, seed=1)(samples(a, b)))


def broken_depth(root):
    (root / "a.depth.png").write_bytes(b"\x89PNG")


def no_valid_depth(root):
    cv2.imwrite(str(root / "a.depth.png"), np.zeros((6, 8), np.uint16))


def no_relative(root):
    (root / "y" / "a.npy").unlink()


def truncated_relative(root):
    data = (root / "y" / "a.npy").read_bytes()
    (root / "y" / "a.npy").write_bytes(data[:-9])


def too_large_for_float16(root):
    np.save(root / "y" / "a.npy", np.full((6, 8), 1e6))


def infinite(root):
    np.save(root / "y" / "a.npy", np.full((6, 8), np.inf, np.float32))


def of_three_channels(root):
    np.save(root / "y" / "a.npy", np.ones((6, 8, 3)))


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (broken_depth, "a.depth.png: not a readable PNG"),
        (no_valid_depth, "no valid pixel"),
        (no_relative, "a: expected a map in a.npy or .png; found neither"),
        (truncated_relative, "a.npy: unreadable .npy"),
        (too_large_for_float16, "too large for float16"),
        (infinite, "too large for float16"),
        (of_three_channels, "found float64 of shape (6, 8, 3)"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_bad_row_is_quarantined_with_its_reason(rooms, damage, says):
    damage(rooms)
    rows = (("a", "train", "a.jpg", "a.depth.png"), ("b", "train", "b.jpg", "b.depth.png"))
    table = step(rooms)(samples(*rows))
    schemas.check("depth", table)
    assert table["status"].to_pylist() == ["failed", "ok"]
    error = table["error"][0].as_py()
    assert says in error
    assert str(rooms) not in error


def test_nan_in_the_ground_truth_is_not_valid(rooms):
    depth = np.full((6, 8), np.nan, np.float32)
    depth[1, 1:4] = 2, 3, np.inf
    dataset = replace(ROOMS, read_depth=lambda path: depth)
    made = build(dataset=dataset, root=rooms, depth_model=f"files:{rooms}/y", pixels=8)
    row = made(samples(("a", "train", "a.jpg", "x"))).to_pylist()[0]
    assert (row["status"], row["n_valid"]) == ("ok", 2)


def test_the_training_mask_applies(rooms):
    mask = np.zeros((6, 8), bool)
    mask[2, 3:5] = True
    dataset = replace(ROOMS, train_mask=lambda height, width: mask)
    made = build(dataset=dataset, root=rooms, depth_model=f"files:{rooms}/y", pixels=2)
    row = made(samples(("a", "train", "a.jpg", "a.depth.png"))).to_pylist()[0]
    truth = read_millimetres(rooms / "a.depth.png")[2, 3:5].astype(np.float16)
    assert set(np.frombuffer(row["metric"], "<f2")) == set(truth)


def test_the_dataset_brings_its_own_relative_depth(rooms):
    dataset = replace(ROOMS, relative=lambda image: f"y/{image.removesuffix('.jpg')}.npy")
    row = ("a", "train", "a.jpg", "a.depth.png")
    own = build(dataset=dataset, root=rooms, depth_model="files")(samples(row))
    assert own.equals(step(rooms)(samples(row)))
    with pytest.raises(UsageError, match="files:DIR"):
        build(dataset=ROOMS, root=rooms, depth_model="files")


@pytest.mark.parametrize("holds", ["relative", "depth"])
def test_files_of_16_bits(tmp_path, holds):
    values = np.array([[0, 1000], [2000, 65535]], np.uint16)
    cv2.imwrite(str(tmp_path / "x.png"), values)
    with np.errstate(divide="ignore"):
        inverse = np.where(values > 0, 1000 / values.astype(np.float64), np.nan)
    expected = values / 65535 if holds == "relative" else inverse
    np.testing.assert_allclose(files.read(tmp_path, "x", holds).y, expected, rtol=1e-6)


def test_files_of_8_bits_are_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "x.png"), np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(RowError, match="a 16-bit grey PNG, found 8 bits, RGB"):
        files.read(tmp_path, "x")


def test_a_real_model_on_real_frames(shared):
    """y covers the model's centre crop; its fit is that of the map stored for the test split."""
    root = shared / "rgbd" / "7scenes"
    weights = shared / "models" / "tu2020_mbv2_blconv7dw_nyu_224.onnx"
    made = build(dataset=ROOMS, root=root, depth_model="tu2020", depth_weights=weights)
    frame = ("frame-000500.color.jpg", "frame-000500.depth.png")
    train, test = made(samples(("a", "train", *frame), ("a", "test", *frame))).to_pylist()
    y, gt = (
        np.frombuffer(test[c], "<f2").reshape(480, 640).astype(float)
        for c in ("relative", "metric")
    )
    valid = ~np.isnan(y) & (gt > 1e-3) & (gt < 10)
    assert valid[:, :96].sum() == valid[:, 544:].sum() == 0
    assert train["n_valid"] == test["n_valid"] == valid.sum() > 150_000
    slope, intercept, *_ = scipy.stats.linregress(y[valid], 1 / gt[valid])
    assert (train["fit_scale"], train["fit_shift"]) == pytest.approx((slope, intercept), rel=2e-2)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"depth_model": "tu2021"}, "Did you mean 'tu2020'"),
        ({"depth_model": "tu2020:x"}, "takes no argument"),
        ({"depth_model": "tu2020", "geometry": "12"}, "WIDTHxHEIGHT"),
        ({"depth_model": "files:/no/such/folder"}, "no such folder"),
        ({"depth_model": "files", "device": "cuda"}, "--device has no effect"),
    ],
    ids=["name", "argument", "geometry", "folder", "device"],
)
def test_a_wrong_call_is_refused_before_anything_is_begun(options, says):
    with pytest.raises(UsageError, match=says):
        model_files(**options)


def test_a_table_from_before_there_was_a_device_goes_on():
    options = stages.bind("depth", {"depth_model": "tu2020"}).options
    settle = stages.stage("depth").settle
    older = {name: value for name, value in options.items() if name != "device"}
    assert settle(options, older) == older
    assert settle(options, options) == settle(options, None) == options
    assert settle({**options, "device": "cpu"}, older)["device"] == "cpu"
    assert "device" not in settle({**options, "depth_model": "files:x"}, None)


def test_no_pixels_are_refused():
    with pytest.raises(UsageError, match="pixels: expected a whole number, 1 to"):
        stages.bind("depth", {"depth_model": "files", "pixels": 0})


@pytest.mark.parametrize(
    ("output", "says"),
    [(np.zeros((1, 3549, 85)), "one map of depth"), (None, "Is --depth-weights the file")],
    ids=["another output", "another input"],
)
def test_a_file_of_another_model_is_refused(output, says):
    class Session:
        def run(self, names, inputs):
            if output is None:
                raise RuntimeError("INVALID_ARGUMENT: Got 224 Expected 416")
            return [output]

    with pytest.raises(RsaDataError, match=says):
        onnx.answer(Session(), "x", np.zeros((1, 3, 224, 224), np.float32), "tu2020", "y")


def test_folders_of_depth_files_are_tables_of_their_own():
    assert stages.label_of("files") == "files"
    assert stages.label_of("files:a/zoe/") == "files-zoe"


def test_a_map_of_another_shape_than_the_image_fails(rooms):
    step(rooms)  # the images of the fixture cannot be read, so nothing is compared
    cv2.imwrite(str(rooms / "a.jpg"), np.zeros((8, 6, 3), np.uint8))
    cv2.imwrite(str(rooms / "b.jpg"), np.zeros((6, 8, 3), np.uint8))
    rows = (("a", "train", "a.jpg", "a.depth.png"), ("b", "train", "b.jpg", "b.depth.png"))
    found = step(rooms)(samples(*rows)).to_pylist()
    assert (
        "expected the aspect of its image of 6 x 8 px, found 8 x 6, which is transposed"
        in (found[0]["error"])
    )
    assert found[1]["status"] == "ok"


def test_what_was_read_is_said_and_y_the_wrong_way(rooms):
    for name in ("a", "b"):
        np.save(rooms / "y" / f"{name}.npy", read_millimetres(rooms / f"{name}.depth.png"))
    rows = (("a", "train", "a.jpg", "a.depth.png"), ("b", "test", "b.jpg", "b.depth.png"))
    table = step(rooms)(samples(*rows))
    lines = STAGE.notes.write([table.select(STAGE.notes.columns)], depth_model="files:y")
    assert lines[0].startswith("ground truth: median ") and "83% of the pixels valid" in lines[0]
    assert "in 100% of the images y grows with the distance" in lines[1]
    assert "--files-hold depth" in lines[1]


def test_the_spread_that_is_said_is_that_of_percentiles(rooms):
    """Of the 101 values 1 to 2 by .01, evenly; y from 0 to 10."""
    values = np.linspace(1, 2, 101)
    row = {"width": 101, "height": 2, "kind": "map", "n_valid": 101, "fit_scale": None}
    row |= {"relative": (10 * (values - 1)).astype("<f2").tobytes()}
    part = pa.Table.from_pylist([row | {"metric": values.astype("<f2").tobytes()}])
    assert STAGE.notes.write([part]) == [
        "ground truth: median 1.5, 1 to 99%: 1.01 to 1.99 m, 50% of the pixels valid; "
        "y: median 5, 1 to 99%: 0.1 to 9.9"
    ]


def test_the_largest_depth_that_float16_holds(rooms):
    """65,504 m in IEEE 754's binary16; and the range of a map that holds nothing valid."""
    depth = np.full((6, 8), 2, np.float32)
    dataset = replace(ROOMS, read_depth=lambda path: depth)
    measure = build(dataset=dataset, root=rooms, depth_model=f"files:{rooms}/y", pixels=8)
    row = samples(("a", "train", "a.jpg", "x"))
    depth[1, 1] = 65504
    assert measure(row)["status"].to_pylist() == ["ok"]
    depth[1, 1] = 65520
    assert "too large for float16" in measure(row)["error"][0].as_py()
    depth[:] = 12
    depth[0] = 0, 0.0005, *[20] * 6
    assert "it goes from 0.0005 to 20 m" in measure(row)["error"][0].as_py()


def test_y_too_small_for_float16_fails(rooms):
    np.save(rooms / "y" / "a.npy", np.linspace(1e-8, 1e-7, 48).reshape(6, 8))
    (row,) = step(rooms)(samples(("a", "train", "a.jpg", "a.depth.png"))).to_pylist()
    assert "too small for float16" in row["error"]


def test_ground_truth_too_small_for_float16_is_none(rooms):
    def read(path):
        depth = read_millimetres(path)
        return np.where(np.arange(8) < 4, depth, depth * 1e-8)

    anywhere = replace(ROOMS, read_depth=read, min_depth=0.0)
    of_files = {"dataset": anywhere, "root": rooms, "depth_model": f"files:{rooms}/y"}
    rows = samples(("a", "train", "a.jpg", "a.depth.png"))
    (row,) = build(**of_files, pixels=64)(rows).to_pylist()
    assert (row["status"], row["n_valid"]) == ("ok", 20)
    assert np.frombuffer(row["metric"], "<f2").min() >= 1
    nothing = replace(anywhere, read_depth=lambda path: read_millimetres(path) * 1e-8)
    (row,) = build(**of_files | {"dataset": nothing})(rows).to_pylist()
    assert "no ground truth between 6.10352e-05 and 10 m" in row["error"]
