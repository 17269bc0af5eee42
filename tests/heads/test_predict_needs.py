"""What predict needs for a head, and what it says of heads and models that do not fit."""

import json
import re
import shutil

import cv2
import numpy as np
import pytest
from predicting import head_for_images, predict, real, run

from rsa_data.common import cards
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.store.tables import WorkDir


def test_a_head_of_depth_files_gives_words_alone_and_says_why(work, tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((4, 5, 3), np.uint8))
    (p,) = predict(work, tmp_path / "a.png", caption=("a",))
    assert p.depth is None and any("came from files" in w for w in p.warnings)
    done = run(work, tmp_path / "a.png", "--caption", "a", "--colours")
    assert done.exit_code == 1 and "there is no depth to write" in done.stderr


def test_a_head_of_rendered_scenes_is_refused_before_files_are_asked_for(
    work, tmp_path, monkeypatch
):
    path = work.store.folder / "heads/head/head.json"
    about = json.loads(path.read_text()) | {"datasets": {"rooms": {"synthetic": True}}}
    del about["digest"]  # as of a head that was written before there were digests
    path.write_text(json.dumps(about))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((4, 5, 3), np.uint8))
    done = run(work, tmp_path / "a.png", "--segments", "maskformer")
    assert isinstance(done.exception, UsageError)
    assert "trained on rendered relative depth" in str(done.exception)
    assert "maskformer" not in str(done.exception)
    (p,) = predict(work, tmp_path / "a.png", caption=("a kitchen",))
    assert p.depth is None and p.scale > 0


def test_a_file_of_another_depth_model_says_how_to_name_it(shared, tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((480, 640, 3), np.uint8))
    file = real(shared)["depth_weights"]
    words = [tmp_path / "a.png", "--range", "1,5", "--depth-weights", file]
    done = run(WorkDir(tmp_path / "none"), *words, "--json")
    assert isinstance(done.exception, UsageError) and not done.stdout
    assert "expected a file of depth-anything-v2-small" in str(done.exception)
    assert "Give --depth-model NAME" in str(done.exception)
    assert "ONNXRuntime" not in str(done.exception)


def test_a_head_for_another_depth_model_is_refused(work, tmp_path):
    head_for_images(work)
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((4, 5, 3), np.uint8))
    with pytest.raises(UsageError, match="expected tu2020, for which the head was trained"):
        predict(work, tmp_path / "a.png", caption=("a",), depth_model="midas-v21-small")


def test_of_two_heads_of_one_name_the_path_is_taken_and_that_is_said(work, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(work.store.folder / "heads/head", tmp_path / "head")
    with pytest.warns(UserWarning, match="several of this name; the path head is taken"):
        (p,) = predict(work, head="head", caption=("a kitchen",))
    assert p.scale > 0


def test_a_panorama_is_named_and_its_points_are_called_bent(work, tmp_path):
    cv2.imwrite(str(tmp_path / "wide.png"), np.zeros((20, 40, 3), np.uint8))
    np.save(tmp_path / "wide.npy", np.full((20, 40), 0.5, np.float32))
    options = {"caption": ("a",), "relative": tmp_path / "wide.npy"}
    (p,) = predict(work, tmp_path / "wide.png", **options)
    assert any("360-degree panorama" in text for text in p.warnings)
    (p,) = predict(work, tmp_path / "wide.png", **options, fov=90.0)
    assert p.warnings == ["the caption names no object that a class table has"]


def test_a_work_dir_without_a_head_names_those_below_it(work, tmp_path):
    above = WorkDir(work.store.folder.parent)
    for name in (None, "hed"):
        with pytest.raises(UsageError, match=rf"--work {work.store.location} holds head\."):
            predict(above, caption=("a kitchen",), head=name)


def test_all_missing_files_are_listed_at_once(work, tmp_path, monkeypatch):
    head_for_images(work)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((4, 5, 3), np.uint8))
    with pytest.raises(RsaDataError) as error:
        predict(work, tmp_path / "a.png", segments="maskformer")
    text = str(error.value)
    assert text.startswith("2 files are missing:")
    assert "--segmenter-weights FILE" in text and "--depth-weights FILE" in text


def test_a_published_head_lists_all_that_it_needs_with_sizes(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    # The shipped cards, with an address where nobody answers.
    shutil.copytree(cards.CARDS, tmp_path / "cards")
    for path in (tmp_path / "cards").glob("*.toml"):
        text, here = path.read_text(), 'url = "http://127.0.0.1:9/f"'
        if "sha256" in text:
            path.write_text(re.sub(r"^(hub|url) = .*$", here, text, flags=re.MULTILINE))
    monkeypatch.setattr(cards, "CARDS", tmp_path / "cards")
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((4, 5, 3), np.uint8))
    with pytest.raises(RsaDataError) as error:
        predict(WorkDir(tmp_path / "none"), tmp_path / "a.png", head="rsa-depth-anything")
    said = str(error.value).splitlines()
    assert said[0] == "4 files are missing (498.1 MB and those of unknown size):"
    for line, name, size, option in zip(
        said[1:5],
        ("rsa-depth-anything", "detr-resnet-50-panoptic", "clip-rn50", "depth-anything-small"),
        ("3.2 MB", "86.6 MB", "408.3 MB", "size not known"),
        ("--head", "--segmenter-weights", "--encoder-weights", "--depth-weights"),
        strict=True,
    ):
        assert line.startswith(f"- {name} (") and size in line and f"{option} FILE" in line
        assert f"put it at {tmp_path / 'cache'}" in line
    assert said[5].endswith(
        "rsa-data models fetch rsa-depth-anything detr-resnet-50-panoptic clip-rn50"
    )
