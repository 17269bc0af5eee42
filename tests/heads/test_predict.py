"""Use of a head: captions, known points, ranges, frames, and the files that come out."""

import json
import shutil
import tempfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from predicting import head_for_images, predict, real, run

from rsa_data.cli.main import cli
from rsa_data.common import options as binding
from rsa_data.common.errors import RsaDataError
from rsa_data.heads.checkpoint import ScaleHead
from rsa_data.heads.predict.predict import predict as predict_function
from rsa_data.store.tables import WorkDir

CAPTION = "a small bathroom with a sink, a mirror and a towel"


def test_a_caption_gives_scale_shift_their_spread_and_a_warning(work):
    (p,) = predict(work, caption=(CAPTION,))
    scale, shift = ScaleHead.load(work.store.folder / "heads/head").predict([CAPTION])
    np.testing.assert_allclose([p.scale, p.shift], [scale[0], shift[0]], rtol=1e-5)
    assert p.spread is not None and p.spread[0] < p.spread[1]
    assert p.unlike and any("unlike anything the head was trained on" in w for w in p.all_warnings)
    assert p.lines[0].startswith(f"scale {p.scale:.6g}  shift {p.shift:.6g}  ")


def test_a_file_of_captions_gives_one_prediction_a_line(work, tmp_path):
    (tmp_path / "captions.txt").write_text("a kitchen\n\na street with cars\n")
    found = predict(work, captions=tmp_path / "captions.txt")
    assert [p.caption for p in found] == ["a kitchen", "a street with cars"]


def test_relative_depth_becomes_metric_depth(work, y, tmp_path):
    out = tmp_path / "new" / "depth.npy"
    relative = tmp_path / "y.npy"
    (p,) = predict(work, caption=("a kitchen",), relative=relative)
    np.testing.assert_allclose(p.depth, 1 / (p.scale * y + p.shift), rtol=1e-6)
    assert p.range == pytest.approx(tuple(np.percentile(p.depth, [0.5, 50, 99.5])))
    done = run(work, "--caption", "a kitchen", "--relative", relative, "--out", out)
    assert done.exit_code == 0 and f"wrote {out}" in done.output
    np.testing.assert_array_equal(np.load(out), p.depth)


def test_a_relative_file_that_is_named_is_read_alone(tmp_path):
    y = np.linspace(1, 2, 20, dtype=np.float32).reshape(4, 5)
    np.save(tmp_path / "y.npy", y)
    cv2.imwrite(str(tmp_path / "y.png"), np.full((4, 5), 65535, np.uint16))
    for name, expected in (("y.npy", 2 / y), ("y.png", np.full((4, 5), 2.0))):
        (p,) = predict(WorkDir(tmp_path / "none"), relative=tmp_path / name, known=("0,0,2",))
        np.testing.assert_allclose(p.depth, expected, rtol=1e-6)


def frames_with_maps(tmp_path, names=("0.png", "1.png", "2.png")):
    """Folders of photos and of their relative depth."""
    frames, maps = tmp_path / "frames", tmp_path / "maps"
    frames.mkdir(), maps.mkdir()
    for i, name in enumerate(names):
        cv2.imwrite(str(frames / name), np.full((4, 5, 3), i, np.uint8))
        np.save(maps / f"{name.partition('.')[0]}.npy", np.full((4, 5), i + 1, np.float32))
    return frames, maps


def test_a_folder_of_photos_takes_one_description_and_a_map_each(work, tmp_path):
    frames, maps = frames_with_maps(tmp_path)
    words = ("--caption", "a kitchen", "--relative", maps, "--out", tmp_path / "o", "--kind", "png")
    done = run(work, frames, *words, "--json")
    found = json.loads(done.stdout)
    assert [p["image"] for p in found] == ["0.png", "1.png", "2.png"]
    assert len({p["scale"] for p in found}) == 1
    depth = cv2.imread(str(tmp_path / "o/2.png"), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.uint16
    expected = 1000 / (found[2]["scale"] * 3 + found[2]["shift"])
    np.testing.assert_allclose(depth, expected, atol=1)


def test_frames_are_smoothed_in_order(work, tmp_path):
    """The geometric mean over three frames, two at the ends; each frame told by itself."""
    frames, maps = frames_with_maps(tmp_path)
    told = {"caption": ("a kitchen", "a street", "a church"), "relative": maps}
    raw = predict(work, frames, **told)
    found = predict(work, frames, **told, smooth=3)
    for name in ("scale", "shift"):
        a, b, c = np.log([getattr(p, name) for p in raw])
        expected = np.exp([(a + b) / 2, (a + b + c) / 3, (b + c) / 2])
        assert [getattr(p, name) for p in found] == pytest.approx(expected, rel=1e-5)


def test_frames_come_in_natural_order_without_hidden_files(work, tmp_path):
    frames, maps = frames_with_maps(tmp_path, ("f10.png", "f2.png", "f1.png"))
    (frames / "._f1.png").write_bytes(b"Mac OS X")
    found = predict(work, frames, caption=("a kitchen",), relative=maps)
    assert [p.name for p in found] == ["f1.png", "f2.png", "f10.png"]


@pytest.mark.parametrize(
    "words",
    [
        "FRAMES --relative MAPS --out FRAMES --kind png",
        "FRAMES --relative MAPS --out MAPS",
        "FRAMES/0.png --relative MAPS/0.npy --out FRAMES/../frames/0.png",
        "FRAMES/0.png --relative MAPS/0.npy --out MAPS/0.npy",
        "FRAMES/0-colours.png --relative MAPS/0.npy --out FRAMES/0.npy --colours",
    ],
)
def test_what_is_read_is_never_written_over(work, tmp_path, words):
    frames, maps = frames_with_maps(tmp_path)
    shutil.copy(frames / "1.png", frames / "0-colours.png")
    shutil.copy(maps / "1.npy", maps / "0-colours.npy")
    before = {path: path.read_bytes() for path in (*frames.iterdir(), *maps.iterdir())}
    words = words.replace("FRAMES", str(frames)).replace("MAPS", str(maps)).split()
    done = run(work, *words, "--caption", "a kitchen")
    assert "expected a file that is not read in the same call" in f"{done.output}{done.exception}"
    assert {path: path.read_bytes() for path in (*frames.iterdir(), *maps.iterdir())} == before


def test_two_photos_of_one_stem_get_a_file_each(work, tmp_path):
    frames, maps = frames_with_maps(tmp_path, ("a.jpg", "a.png"))
    out = tmp_path / "o"
    assert run(work, frames, "--caption", "x", "--relative", maps, "--out", out).exit_code == 0
    assert sorted(f.name for f in out.iterdir()) == ["a.npy", "a.png.npy"]


def test_a_broken_photo_is_named_and_the_others_are_done(work, tmp_path):
    frames, maps = frames_with_maps(tmp_path)
    (frames / "1.png").write_bytes((frames / "1.png").read_bytes()[:40])
    out = tmp_path / "o"
    done = run(work, frames, "--caption", "x", "--relative", maps, "--out", out)
    assert done.exit_code == 1 and str(done.exception) == "1 photo could not be processed"
    assert "1.png: unreadable PNG" in done.stderr
    assert sorted(f.name for f in out.iterdir()) == ["0.npy", "2.npy"]
    said = json.loads(run(work, frames, "--caption", "x", "--relative", maps, "--json").stdout)
    assert ["error" in p for p in said] == [False, True, False]


def test_a_video_is_a_folder_of_frames(work, tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 5, (32, 24))
    for k in range(3):
        writer.write(np.full((24, 32, 3), 60 * k, np.uint8))
    writer.release()
    (tmp_path / "maps" / "v.avi").mkdir(parents=True)
    for k in (1, 2, 3):
        np.save(tmp_path / f"maps/v.avi/{k:06d}.npy", np.full((24, 32), k, np.float32))
    found = predict(work, tmp_path / "v.avi", caption=("a",), relative=tmp_path / "maps")
    assert [p.name for p in found] == [f"v.avi/{k:06d}.png" for k in (1, 2, 3)]
    assert not any(p.error for p in found)
    # Every frame is its own picture, again when smoothing goes over them twice; few lie on disk.
    for smooth in (0, 3):
        seen = []
        options = {"caption": ("a",), "relative": tmp_path / "maps", "smooth": smooth}
        for p in binding.call(predict_function, work, [tmp_path / "v.avi"], **options):
            assert len(list(Path(tempfile.gettempdir()).glob("rsa-data-frames-*/0/v.avi/*"))) <= 2
            seen.append(float(p.image.mean()))
        np.testing.assert_allclose(seen, [0, 60, 120], atol=3)
    out = tmp_path / "one.png"
    done = run(
        work, tmp_path / "v.avi", "--relative", tmp_path / "maps", "--range", "1,5", "--out", out
    )
    assert "one file for several photos" in str(done.exception) and not out.exists()
    (tmp_path / "no.mp4").write_bytes(b"no video")
    with pytest.raises(RsaDataError, match="expected a video"):
        predict(work, tmp_path / "no.mp4", caption=("a",), relative=tmp_path / "maps")


def test_a_video_that_ends_early_is_said_so(work, tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 5, (64, 48))
    rng = np.random.default_rng(0)
    for _ in range(20):
        writer.write(rng.integers(0, 255, (48, 64, 3), np.uint8))
    writer.release()
    data = (tmp_path / "v.avi").read_bytes()
    (tmp_path / "short.avi").write_bytes(data[: len(data) // 2])
    (tmp_path / "maps/short.avi").mkdir(parents=True)
    for k in range(1, 21):
        np.save(tmp_path / f"maps/short.avi/{k:06d}.npy", np.full((48, 64), k, np.float32))
    found = predict(work, tmp_path / "short.avi", caption=("a",), relative=tmp_path / "maps")
    assert 2 < len(found) < 18 and not any(p.error for p in found)
    assert f"short.avi ends early: {len(found)} of its 20 frames" in found[0].warnings[-1]
    assert not any(p.warnings and "ends early" in p.warnings[0] for p in found[1:])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("", "expected photos, --caption TEXT or --captions FILE"),
        ("--caption a --out x.npy", "there is no depth to write"),
        ("--caption a --known 1,1,2", "need a photo or --relative"),
        ("--caption a --relative y.npy --known 1,1,x", "expected u,v,metres; found '1,1,x'"),
        ("--caption a --relative y.npy --known 8,1,2", "expected a pixel of the relative depth"),
        ("--caption a --relative y.npy --known 1,1,-2", "expected a distance of 0.001 m"),
        ("--caption a --relative y.npy --range 5,2", "expected near below far"),
        ("--caption a --relative y.npy --range=-1,2", "expected near below far"),
        ("--caption a --relative y.npy --range 0,2", "expected near below far"),
        ("--caption a --relative y.npy --range 5,inf", "expected near,far in metres"),
        ("--caption a --relative y.npy --range 5", "expected near,far in metres"),
        ("--caption a --caption b --relative y.npy", "without photos take one --caption"),
        ("nowhere --caption a", "expected an image, a video or a folder; there is none"),
        ("https://example.org/a.jpg --caption a", "read from files; download it first"),
        ("--caption a --relative no.npy", "expected a file or folder; there is none"),
        ("--caption a --relative y.exr", "expected a .npy or .png file"),
        ("a.png --caption a --relative y.npy --out x.exr", ".exr is not written"),
        ("a.png --relative y.npy --range 1,5 --smooth 3", "averages what a head says"),
        (
            "a.png --caption a --relative y.npy --known 8,1,2",
            "expected a pixel of the photo, 8 x 6",
        ),
        ("--caption a --relative y.npy --intrinsics 1,2", "expected fx,fy,cx,cy"),
        (
            "--caption a --relative y.npy --intrinsics 0,5,4,3",
            "expected focal lengths of at least 1 px",
        ),
        (
            "--caption a --relative y.npy --intrinsics 5,0,4,3",
            "expected focal lengths of at least 1 px",
        ),
        ("--caption a --relative y.npy --fov 200", "1 to 179"),
        ("--caption a --relative y.npy --out x.glb", "a textured mesh needs the photo"),
        ("a.png a.png --caption a --relative y.npy --out x.npy", "one file for several photos"),
        ("--captions long.txt", "expected captions of at most 100,000 characters, found one of 5"),
        ("--caption a\udcff", "expected UTF-8 text; found 'a\\udcff'"),
        ("--caption a --relative y.npy --out work/heads/head/o.npy", "outside of the tables and"),
        ("--caption a --head hed", "Did you mean 'head'"),
        ("--caption a --head no/such", "there is no such file or folder"),
        ("--caption a --head ftp://x/y", "expected https://... or hf://OWNER/NAME"),
        ("a.png --caption a --depth-model tu2020", "came from files, and which model"),
        ("--relative y.npy --known 1,1,2 --known 1,1,2", "the same at all points"),
        ("--relative y.npy --known 1,1,2 --head head", "a head needs a photo or a --caption"),
        ("a.png --relative y.npy --range 1,5 --segmenter-weights a.png", "name the segmenter with"),
        ("--caption a --card a.png", "--card has no effect here"),
        ("a.png --relative y.npy --range 1,5 --kind png", "no folder is given"),
        ("a.png --relative y.npy --range 1,5 --kind png --out x.npy", "no folder is given"),
    ],
)
def test_calls_that_do_not_add_up_are_refused(work, y, tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("a.png", np.zeros((6, 8, 3), np.uint8))
    (tmp_path / "long.txt").write_text("a bed, " * 750_000)
    (tmp_path / "work/heads/head/_table.json").write_text("{}")  # as a training leaves it
    done = run(work, *words.split())
    assert done.exit_code != 0 and message in f"{done.output}{done.exception}"


def test_maps_that_cannot_be_read_say_which(work, tmp_path):
    (tmp_path / "bad.npy").write_bytes(b"no")
    with pytest.raises(RsaDataError, match=r"bad.npy: unreadable"):
        predict(work, caption=("a",), relative=tmp_path / "bad.npy")


def test_a_caption_without_a_known_opening_says_that_it_has_no_spread(work):
    (p,) = predict(work, caption=("a bed, a sink and a towel",))
    assert p.spread is None and any("no spread" in note for note in p.notes)


def test_a_photo_is_described_by_a_detector_and_made_metric(work, shared, tmp_path):
    head_for_images(work)
    image = shared / "rgbd/misc/emsanet_rgb.png"
    (p,) = predict(work, image, **real(shared), intrinsics="570,570,320,240")
    assert p.name == "emsanet_rgb.png" and "couch" in p.caption
    (couch,) = [seen for seen in p.objects if seen.label == "couch"]
    # The central half of its box, whose size the area tells.
    assert couch.over == "the central half of its box"
    near, middle, far = p.range
    assert near < couch.distance < far and near < middle < far
    assert p.plain()["objects"][0] == {
        "label": p.objects[0].label,
        "area": pytest.approx(p.objects[0].area, rel=1e-5),
        "distance": pytest.approx(p.objects[0].distance, rel=1e-5),
    }
    assert f"couch, {couch.area:.1%} of the image, {couch.distance:.2f} m" in "\n".join(p.lines)


def test_a_folder_of_frames_is_smoothed_and_keeps_its_names(work, shared, tmp_path):
    head_for_images(work)
    frames = tmp_path / "frames"
    frames.mkdir()
    for i in (0, 10, 20):
        name = f"frame-{i:06d}.color.jpg"
        shutil.copy(shared / "rgbd/7scenes" / name, frames / name)
    raw = predict(work, frames, **real(shared))
    smoothed = predict(work, frames, **real(shared), smooth=3)
    mean = np.exp(np.mean(np.log([p.scale for p in raw])))
    assert smoothed[1].scale == pytest.approx(mean, rel=1e-5)
    assert [p.name for p in smoothed] == [f"frame-{i:06d}.color.jpg" for i in (0, 10, 20)]


def test_the_commands_print_what_came_of_it(work, shared):
    place = ["--work", work.store.location]
    done = CliRunner().invoke(cli, ["predict", "--caption", "a kitchen", *place])
    assert done.exit_code == 0 and done.output.startswith("scale ")
    file = str(shared / "rsa_heads/da_lanscale.pt")
    done = CliRunner().invoke(cli, ["import-head", file, "--name", "da", *place])
    assert done.exit_code == 0, done.output
    assert "test measures, nyu" in done.output and "abs_rel 0.1418" in done.output
    assert ScaleHead.load(work.store.folder / "heads/da").description["imported"]["steps"] == 47500
