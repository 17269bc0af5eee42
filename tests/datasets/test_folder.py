"""The dataset of one's own images: layouts, depth, held-out images, and what it refuses."""

import pytest

from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.datasets.folder import folder
from rsa_data.datasets.index import open_dataset
from rsa_data.store import schemas


def touch(root, *paths):
    for path in paths:
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).touch()


def seen(dataset, root):
    """{sample_id without the dataset's name: (scene, image, depth)}."""
    table = dataset.index(root, None)
    schemas.check("samples", table)
    columns = (table[c].to_pylist() for c in ("sample_id", "scene", "image", "depth"))
    return {
        key.removeprefix("folder/"): rest for key, *rest in map(list, zip(*columns, strict=True))
    }


def test_any_images_at_any_depth_but_nothing_else(tmp_path):
    touch(tmp_path, "a.JPG", "trip/b c.png", "trip/notes.txt", "trip/.thumb.jpg", ".cache/x.png")
    assert seen(folder(), tmp_path) == {
        "train/a": [".", "a.JPG", None],
        "train/trip/b c": ["trip", "trip/b c.png", None],
    }


def test_depth_in_the_place_of_images(tmp_path):
    touch(tmp_path, "run1/rgb/0.jpg", "run1/depth/0.png", "run1/other/0.jpg")
    touch(tmp_path, "run2/rgb/left/1.jpg", "run2/depth/left/1.npy", "run2/rgb/left/2.jpg")
    dataset = folder(images="rgb", depth="depth", depth_unit="mm")
    assert seen(dataset, tmp_path) == {
        "train/run1/0": ["run1", "run1/rgb/0.jpg", "run1/depth/0.png"],
        "train/run2/left/1": ["run2/left", "run2/rgb/left/1.jpg", "run2/depth/left/1.npy"],
        "train/run2/left/2": ["run2/left", "run2/rgb/left/2.jpg", None],
    }


def test_depth_before_the_whole_path(tmp_path):
    touch(tmp_path, "0.png", "run/1.png", "depth/0.png", "depth/run/1.png")
    assert seen(folder(depth="depth", depth_unit="m/5000"), tmp_path) == {
        "train/0": [".", "0.png", "depth/0.png"],
        "train/run/1": ["run", "run/1.png", "depth/run/1.png"],
    }


def test_depth_of_the_nearest_time(tmp_path):
    touch(tmp_path, "tum/rgb/1.10.png", "tum/rgb/1.13.png", "tum/rgb/1.17.png", "tum/rgb/9.0.png")
    touch(tmp_path, "tum/depth/1.111.png", "tum/depth/1.149.png", "tum/depth/readme.txt")
    dataset = folder(images="rgb", depth="depth", depth_unit="m/5000", depth_within=0.0215)
    assert seen(dataset, tmp_path) == {
        "train/tum/1.10": ["tum", "tum/rgb/1.10.png", "tum/depth/1.111.png"],
        "train/tum/1.13": ["tum", "tum/rgb/1.13.png", "tum/depth/1.111.png"],
        "train/tum/1.17": ["tum", "tum/rgb/1.17.png", "tum/depth/1.149.png"],
        "train/tum/9.0": ["tum", "tum/rgb/9.0.png", None],
    }
    touch(tmp_path, "tum/rgb/first.png")
    with pytest.raises(RsaDataError, match=r"names that are numbers.* found first.png"):
        dataset.index(tmp_path, None)


def test_split_folders(tmp_path):
    touch(tmp_path, "train/home/0.png", "val/home/1.png", "test/yard/train/2.png")
    assert seen(folder(), tmp_path) == {
        "test/yard/train/2": ["yard/train", "test/yard/train/2.png", None],
        "train/home/0": ["home", "train/home/0.png", None],
        "val/home/1": ["home", "val/home/1.png", None],
    }


def test_test_share_takes_the_last_frames_of_one_scene_in_the_order_of_their_numbers(tmp_path):
    touch(tmp_path, *(f"frame_{n}.png" for n in range(12)))
    found = seen(folder(test_share=0.25), tmp_path)
    held = [key for key in found if key.startswith("test/")]
    assert held == ["test/frame_10", "test/frame_11", "test/frame_9"]
    assert len(found) == 12


def test_test_share_takes_whole_scenes_and_leaves_one(tmp_path):
    touch(tmp_path, *(f"{scene}/{n}.png" for scene in "abc" for n in range(4)))
    held = {key for key in seen(folder(test_share=0.4), tmp_path) if key.startswith("test/")}
    assert held == {f"test/{scene}/{n}" for scene in "bc" for n in range(4)}
    held = [key for key in seen(folder(test_share=0.99), tmp_path) if key.startswith("test/")]
    assert len(held) == 8


def test_test_list(tmp_path):
    touch(tmp_path, "a/0.png", "a/1 b.png")
    (tmp_path / "held.txt").write_text("a/1 b.png\n")
    found = seen(folder(test_list=tmp_path / "held.txt"), tmp_path)
    assert list(found) == ["test/a/1 b", "train/a/0"]


@pytest.mark.parametrize("text", ["615,616.5,320,240", "camera.txt"])
def test_intrinsics(tmp_path, text):
    touch(tmp_path, "0.png")
    (tmp_path / "camera.txt").write_text("615 0 320\n0 616.5 240\n0 0 1\n")
    row = folder(intrinsics=text).index(tmp_path, None).to_pylist()[0]
    assert [row[c] for c in ("fx", "fy", "cx", "cy")] == [615, 616.5, 320, 240]


def test_links_to_folders_are_followed_once(tmp_path):
    touch(tmp_path, "real/0.png")
    (tmp_path / "root" / "loop").mkdir(parents=True)
    (tmp_path / "root" / "data").symlink_to(tmp_path / "real")
    (tmp_path / "root" / "loop" / "up").symlink_to(tmp_path / "root")
    assert list(seen(folder(), tmp_path / "root")) == ["train/data/0"]


WRONG_OPTIONS = {
    "depth without unit": ({"depth": "depth"}, "no unit is ever guessed"),
    "unknown unit": ({"depth": "d", "depth_unit": "inch"}, "expected m, cm, mm or m/N"),
    "no steps": ({"depth": "d", "depth_unit": "m/0"}, "expected m, cm, mm or m/N"),
    "distance without depth": ({"depth_within": 0.1}, "depth_within goes together with depth"),
    "share of all": (
        {"test_share": 1.0},
        "expected a number, 0 or more, less than 1; found 1.0",
    ),
    "two ways to hold out": ({"test_share": 0.1, "test_list": "x"}, "found both"),
    "empty range": ({"min_depth": 2.0, "max_depth": 1.0}, "expected 0 < min_depth < max_depth"),
}


@pytest.mark.parametrize(("options", "reason"), WRONG_OPTIONS.values(), ids=WRONG_OPTIONS)
def test_options_that_make_no_sense(options, reason):
    with pytest.raises(UsageError) as caught:
        open_dataset("folder:own", options)
    assert reason in str(caught.value)


WRONG_FOLDERS = {
    "nothing": ([], {}, "expected images of any split, found none"),
    "no images": (["a.txt"], {}, "expected images of any split, found none"),
    "same key": (["a.png", "a.jpg"], {}, "found a.jpg and a.png with the same key train/a"),
    "outside splits": (["train/a.png", "b.png"], {}, "expected all images in train, found b.png"),
    "no depth at all": (
        ["x/rgb/a.png"],
        {"images": "rgb", "depth": "depth", "depth_unit": "mm"},
        "expected depth such as x/depth/a.png for the image x/rgb/a.png, found none",
    ),
    "share and test folder": (["test/a.png"], {"test_share": 0.5}, "found both"),
    "bad intrinsics": (["a.png"], {"intrinsics": "1,2,3"}, "expected fx,fy,cx,cy in px"),
    "missing intrinsics": (["a.png"], {"intrinsics": "k.txt"}, "No such file"),
    "intrinsics outside": (["a.png"], {"intrinsics": "../k"}, "below the dataset's root"),
}


@pytest.mark.parametrize(("files", "options", "reason"), WRONG_FOLDERS.values(), ids=WRONG_FOLDERS)
def test_folders_that_make_no_sense(tmp_path, files, options, reason):
    touch(tmp_path, *files)
    with pytest.raises(RsaDataError) as caught:
        folder(**options).index(tmp_path, None)
    assert reason in str(caught.value)


def test_a_list_that_names_no_image(tmp_path):
    touch(tmp_path, "a.png")
    (tmp_path / "held.txt").write_text("a.png\nb.png\n")
    with pytest.raises(RsaDataError, match=r"held.txt line 2: expected .* found 'b.png'"):
        folder(test_list=tmp_path / "held.txt").index(tmp_path, None)


def test_names_that_are_not_utf8_are_named(tmp_path):
    touch(tmp_path, "bad\udcff.png")
    with pytest.raises(RsaDataError, match=r"expected file names in UTF-8, found .*bad"):
        folder().index(tmp_path, None)
