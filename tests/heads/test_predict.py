"""Use of a head: captions, known points, ranges, frames, and the files that come out."""

import json
import shutil

import cv2
import numpy as np
import pytest
import scipy.optimize
import torch
from click.testing import CliRunner
from rsa_data.heads.predict.outputs import write_depth

from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.heads.checkpoint import ScaleHead, build_network
from rsa_data.heads.predict import known_depth
from rsa_data.heads.predict.images import paraphrases
from rsa_data.heads.predict.predict import predict
from rsa_data.store.tables import WorkDir

CAPTION = "a small bathroom with a sink, a mirror and a towel"


@pytest.fixture
def work(tmp_path) -> WorkDir:
    """A head for minilm, untrained."""
    work = WorkDir(tmp_path / "work")
    features = {"dim": 384, "encoder": "minilm", "files": None}
    features["options"] = {"encoder": "minilm", "normalize": False}
    model = {"model": "files", "options": None, "files": {}, "geometry": {"rooms": {}}}
    about = {"format": 1, "architecture": {"name": "linear"}, "features": features}
    torch.manual_seed(0)
    head = ScaleHead(
        build_network(about["architecture"], 384),
        {**about, "depth_model": model, "far": 0.5},
        torch.zeros(384),
        torch.ones(384),
        np.ones((1, 384), np.float16),
    )
    head.save(work.store, "heads/head")
    return work


@pytest.fixture
def y(tmp_path) -> np.ndarray:
    y = np.random.default_rng(0).uniform(0.5, 4, (6, 8)).astype(np.float32)
    np.save(tmp_path / "y.npy", y)
    return y


def test_a_caption_gives_scale_shift_their_spread_and_a_warning(work):
    found = predict(work, caption=(CAPTION,))
    (p,) = found.predictions
    scale, shift = ScaleHead.load(work.store.folder / "heads/head").predict([CAPTION])
    np.testing.assert_allclose([p.scale, p.shift], [scale[0], shift[0]], rtol=1e-5)
    assert p.spread is not None and p.spread[0] < p.spread[1]
    assert p.unlike and "unlike anything the head was trained on" in found.summary
    assert f"scale {p.scale:.6g}" in found.summary


def test_a_file_of_captions_gives_one_prediction_a_line(work, tmp_path):
    (tmp_path / "captions.txt").write_text("a kitchen\n\na street with cars\n")
    found = predict(work, captions=tmp_path / "captions.txt")
    assert [p.caption for p in found.predictions] == ["a kitchen", "a street with cars"]


def test_relative_depth_becomes_metric_depth(work, y, tmp_path):
    out = tmp_path / "new" / "depth.npy"
    (p,) = predict(work, caption=("a kitchen",), relative=tmp_path / "y.npy", out=out).predictions
    np.testing.assert_allclose(np.load(out), 1 / (p.scale * y + p.shift), rtol=1e-6)
    assert p.written == out


def test_a_folder_of_images_takes_one_description_and_a_map_each(work, tmp_path):
    frames, maps = tmp_path / "frames", tmp_path / "maps"
    frames.mkdir(), maps.mkdir()
    for i in range(3):
        cv2.imwrite(str(frames / f"{i}.png"), np.full((4, 5, 3), i, np.uint8))
        np.save(maps / f"{i}.npy", np.full((4, 5), 1.0 + i, np.float32))
    found = predict(
        work, caption=("a kitchen",), image=frames, relative=maps, out=tmp_path / "o", kind="png"
    ).predictions
    assert [p.name for p in found] == ["0.png", "1.png", "2.png"]
    assert len({p.scale for p in found}) == 1
    depth = cv2.imread(str(tmp_path / "o/2.png"), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.uint16
    expected = 1000 / (found[2].scale * 3 + found[2].shift)
    np.testing.assert_allclose(depth, expected, atol=0.5)


def test_a_known_point_pulls_the_prediction_to_it(work, y, tmp_path):
    relative = {"caption": ("a kitchen",), "relative": tmp_path / "y.npy"}
    (words,) = predict(work, **relative).predictions
    before = 1 / (words.scale * y[2, 3] + words.shift)
    (p,) = predict(work, **relative, known=(f"3,2,{2 * before}",)).predictions
    after = 1 / (p.scale * y[2, 3] + p.shift)
    assert before < after < 2 * before and after > 1.8 * before
    assert "from words alone" in p.notes[0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "expected --caption TEXT, --captions FILE or --image PLACE"),
        ({"caption": ("a",), "out": "x.npy"}, "need --relative or --image"),
        ({"caption": ("a",), "known": ("1,1,x",)}, "expected u,v,metres; found '1,1,x'"),
        ({"caption": ("a",), "known": ("8,1,2",)}, "expected a pixel of the relative depth, 8 x 6"),
        ({"caption": ("a",), "known": ("1,1,-2",)}, "expected depths above 0 m"),
        ({"caption": ("a",), "range": "5,2"}, "expected 0 < near < far"),
        ({"caption": ("a",), "range": "5"}, "expected near,far in metres"),
        ({"caption": ("a", "b"), "out": "x.npy"}, "without --image take one --caption"),
        ({"caption": ("a",), "image": "nowhere"}, "expected an image or a folder"),
        ({"caption": ("a",), "out": "x.ply"}, "needs the camera: --intrinsics"),
        ({"caption": ("a",), "out": "x.ply", "intrinsics": "1,2"}, "expected fx,fy,cx,cy"),
        ({"caption": ("a",), "out": "x.jpg"}, "expected a name ending in .npy, .png, .ply"),
    ],
    ids=lambda value: "" if isinstance(value, str) else " ".join(value) or "nothing",
)
def test_calls_that_do_not_add_up_are_refused(work, y, tmp_path, options, message):
    given = {k: tmp_path / v if k in ("out", "image") else v for k, v in options.items()}
    if "out" not in given or ".np" not in str(given["out"]) or len(given["caption"]) > 1:
        given |= {"relative": tmp_path / "y.npy"} if given else {}
    with pytest.raises(UsageError, match=message):
        predict(work, **given)


def test_maps_that_cannot_be_read_say_which(work, tmp_path):
    (tmp_path / "bad.npy").write_bytes(b"no")
    with pytest.raises(RsaDataError, match=r"bad.npy: not a readable"):
        predict(work, caption=("a",), relative=tmp_path / "bad.npy", out=tmp_path / "x.npy")
    with pytest.raises(RsaDataError, match=r"no head\.json"):
        predict(work, head="other", caption=("a",))


def test_paraphrases_hold_the_same_objects():
    texts = paraphrases(CAPTION)
    assert 1 < len(texts) <= 8 and CAPTION not in texts and len(set(texts)) == len(texts)
    for text in texts:
        start, objects = text.split(" with ")
        assert start == "a small bathroom"
        assert sorted(objects.split(", ")) == ["a mirror", "a sink", "a towel"]
    assert paraphrases("An image.") == paraphrases("a room with a bed") == []


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
    found = known_depth.refine(0.03, 0.2, y, metres, prior, 0.1)
    best = scipy.optimize.minimize(
        cost,
        (0.03, 0.2),
        (0.03, 0.2, y, metres, prior, 0.1),
        bounds=[(0, None)] * 2,
        method="Powell",
        options={"xtol": 1e-10, "ftol": 1e-14, "maxiter": 10000},
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
        found = known_depth.refine(0.09, 0.08, y, 1 / (true_scale * y + true_shift))
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


def test_png_holds_millimetres(tmp_path):
    write_depth(tmp_path / "d.png", np.array([[1.2344, np.inf], [np.nan, 70.0]], np.float32))
    depth = cv2.imread(str(tmp_path / "d.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(depth, np.array([[1234, 65535], [0, 65535]], np.uint16))


def test_ply_holds_points_in_front_of_the_camera(tmp_path):
    depth = np.array([[2.0, np.inf], [np.nan, 4.0]], np.float32)
    colours = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    write_depth(tmp_path / "d.ply", depth, (2.0, 4.0, 0.5, 0.5), colours)
    header, _, body = (tmp_path / "d.ply").read_bytes().partition(b"end_header\n")
    assert b"element vertex 2" in header and b"property uchar red" in header
    kind = [("xyz", "<f4", 3), ("rgb", "u1", 3)]
    points = np.frombuffer(body, kind)
    np.testing.assert_allclose(points["xyz"], [[-0.5, -0.25, 2.0], [1.0, 0.5, 4.0]])
    assert points["rgb"].tolist() == [[0, 1, 2], [9, 10, 11]]


def head_for_images(work: WorkDir) -> None:
    """The head of `work`, with the captions and the depth model of a real training."""
    path = work.store.folder / "heads/head/head.json"
    about = json.loads(path.read_text())
    about["captions"] = {"rooms": {"style": "occupancy", "variants": 5, "tokenizer": "minilm"}}
    geometry = {"rooms": {"geometry": None, "crop": "none"}}
    about["depth_model"] = {"model": "tu2020", "options": {}, "files": {}, "geometry": geometry}
    path.write_text(json.dumps(about))


def test_an_image_is_described_by_a_detector_and_made_metric(work, shared, tmp_path):
    head_for_images(work)
    image = shared / "rgbd/misc/emsanet_rgb.png"
    models = shared / "models"
    (p,) = predict(
        work,
        image=image,
        segments="yolox-nano",
        segmenter_weights=models / "yolox_nano.onnx",
        depth_weights=models / "tu2020_mbv2_blconv7dw_nyu_224.onnx",
        intrinsics="570,570,320,240",
        out=tmp_path / "room.ply",
    ).predictions
    assert p.name == "emsanet_rgb.png" and "couch" in p.caption
    header = (tmp_path / "room.ply").read_bytes().partition(b"end_header")[0]
    assert int(header.split(b"element vertex ")[1].split()[0]) > 10_000


def test_a_folder_of_frames_is_smoothed_and_keeps_its_names(work, shared, tmp_path):
    head_for_images(work)
    frames = tmp_path / "frames"
    frames.mkdir()
    for i in (0, 10, 20):
        name = f"frame-{i:06d}.color.jpg"
        shutil.copy(shared / "rgbd/7scenes" / name, frames / name)
    models = shared / "models"
    given = {
        "image": frames,
        "segments": "yolox-nano",
        "segmenter_weights": models / "yolox_nano.onnx",
        "depth_weights": models / "tu2020_mbv2_blconv7dw_nyu_224.onnx",
    }
    raw = predict(work, **given).predictions
    smoothed = predict(work, **given, smooth=3, out=tmp_path / "o").predictions
    mean = np.exp(np.mean(np.log([p.scale for p in raw])))
    assert smoothed[1].scale == pytest.approx(mean, rel=1e-5)
    assert sorted(f.name for f in (tmp_path / "o").iterdir()) == [
        f"frame-{i:06d}.color.npy" for i in (0, 10, 20)
    ]


def test_a_head_of_depth_files_asks_for_the_images_own(work, tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((4, 5, 3), np.uint8))
    with pytest.raises(UsageError, match="came from files: give the images' own with --relative"):
        predict(work, caption=("a",), image=tmp_path / "a.png", out=tmp_path / "d.npy")


def test_the_commands_print_what_came_of_it(work, shared):
    from rsa_data.cli.main import cli

    place = ["--work", work.store.location]
    done = CliRunner().invoke(cli, ["predict", "--caption", "a kitchen", *place])
    assert done.exit_code == 0 and done.output.startswith("scale ")
    file = str(shared / "rsa_heads/da_lanscale.pt")
    done = CliRunner().invoke(cli, ["import-head", file, "--name", "da", *place])
    assert done.exit_code == 0, done.output
    assert "test measures, nyu" in done.output and "abs_rel 0.1418" in done.output
    assert ScaleHead.load(work.store.folder / "heads/da").description["imported"]["steps"] == 47500
