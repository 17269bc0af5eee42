"""detect with the models of the registry: real weights on real images, wrong calls."""

import json
import shutil
import tomllib

import numpy as np
import pytest
from own_models import run

from rsa_data.common import cards
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.registry import DECODERS, SEGMENTERS, resolve
from rsa_data.segments import detect
from rsa_data.store import schemas


def test_wrong_calls(tmp_path):
    with pytest.raises(UsageError, match="Did you mean 'yolox-nano'"):
        run(tmp_path, [], segments="yolox-nan")
    with pytest.raises(UsageError, match="takes no argument, found 'x'"):
        run(tmp_path, [], segments="yolox-nano:x")
    with pytest.raises(RsaDataError, match="expected the dataset's images; found no folder"):
        run(None, [], segments="yolox-nano")
    with pytest.raises(
        RsaDataError, match=r"not downloaded for you; .*: give it as --segmenter-weights FILE"
    ):
        detect.files(segments="maskformer")


@pytest.mark.parametrize("name", sorted(SEGMENTERS))
def test_every_entry_resolves_and_every_card_is_known(name):
    builder = resolve("segmenter", SEGMENTERS, name)
    assert builder.__doc__
    if SEGMENTERS[name].startswith("rsa_data.segments.onnx") and name != "onnx":
        card = cards.card_of("segments", name)
        assert card.settings["decoder"]["family"] in DECODERS
    assert set(cards.names("segments")) <= set(SEGMENTERS)


# Real weights, on real images.

REAL = {
    "yolox-nano": "yolox_nano.onnx",
    "fastestdet": "FastestDet.onnx",
    "nanodet-m": "nanodet_m.onnx",
    "deeplab-v3-voc": "deeplab_v3_1_default_1.onnx",
    "deeplab-edgetpu-cityscapes": "deeplab_edgetpu_slim_cityscapes_from_tflite.onnx",
    "road-segmentation-adas-0001": "road_segmentation_adas_0001.onnx",
}
DETECTORS = ("yolox-nano", "fastestdet", "nanodet-m")
LIVING_ROOM, STREET, DESK = (
    "rgbd/misc/emsanet_rgb.png",
    "rgbd/kitti_object/000008.png",
    "rgbd/misc/TUM_color.png",
)
BASEMENT, PEOPLE = "rgbd/nyuv2/rgb_00050.jpg", "panoptic_coco/000000142238.jpg"


def labels(shared, name, images):
    found = run(shared, images, segments=name, segmenter_weights=shared / "models" / REAL[name])
    assert found["status"].to_pylist() == ["ok"] * len(images)
    return found["label"].to_pylist()


@pytest.mark.parametrize("name", DETECTORS)
def test_detectors_find_what_is_there(shared, name):
    room, street, desk, basement, people = labels(
        shared, name, [LIVING_ROOM, STREET, DESK, BASEMENT, PEOPLE]
    )
    assert "couch" in room
    assert 5 <= street.count("car") <= 13
    assert set(street) == {"car"}
    assert {"chair", "bottle"} <= set(desk)
    assert len(basement) <= 1
    assert 10 <= people.count("person") <= 18


def test_semantic_models_find_what_is_there(shared):
    room, street = labels(shared, "deeplab-v3-voc", [LIVING_ROOM, STREET])
    assert "couch" in room
    assert "car" in street
    (street,) = labels(shared, "deeplab-edgetpu-cityscapes", [STREET])
    assert {"road", "building", "vegetation", "sky", "car"} <= set(street)
    (street,) = labels(shared, "road-segmentation-adas-0001", ["rgbd/kitti/0000000050.png"])
    assert street[0] == "road"


def test_overlap_with_the_people_of_the_annotation(shared):
    """Boxes of yolox-nano against COCO's own of 142238: most people found, boxes that fit."""
    found = run(
        shared,
        [PEOPLE],
        segments="yolox-nano",
        segmenter_weights=shared / "models" / REAL["yolox-nano"],
    )
    ours = np.array(found["box"][0].as_py())
    content = json.loads((shared / "panoptic_coco" / "panoptic_examples.json").read_text())
    infos = content["annotations"][0]["segments_info"]
    xywh = np.array([i["bbox"] for i in infos if i["category_id"] == 1], float)
    theirs = np.concatenate([xywh[:, :2], xywh[:, :2] + xywh[:, 2:]], 1)
    low = np.maximum(ours[:, None, :2], theirs[None, :, :2])
    high = np.minimum(ours[:, None, 2:], theirs[None, :, 2:])
    inside = np.prod(np.maximum(high - low, 0), 2)
    area = [np.prod(b[:, 2:] - b[:, :2], 1) for b in (ours, theirs)]
    overlap = inside / (area[0][:, None] + area[1][None] - inside)
    # 15 boxes for 14 people of the annotation, which leaves out those far behind.
    found_people = overlap.max(0)
    assert (found_people > 0.5).sum() >= 8, np.round(np.sort(found_people), 2)
    assert np.median(found_people) > 0.5


def test_features_are_those_of_the_kept_cells(shared):
    """NanoDet's distance bins as features: the rows of the cells that were kept."""
    card = tomllib.loads(cards.card_path("yolox-nano").read_text())
    options = {
        "segments": "yolox-nano",
        "segmenter_weights": shared / "models" / REAL["yolox-nano"],
    }
    found = run(shared, [STREET], **options, features=card["output"]["predictions"])
    features = np.stack([np.frombuffer(f, "<f4") for f in found["feature"][0].as_py()])
    assert features.shape == (len(found["label"][0]), 85)
    # The rows carry objectness and classes, so they tell the scores that were kept.
    np.testing.assert_allclose(
        features[:, 4] * features[:, 5:].max(1), found["score"][0].as_py(), rtol=1e-6
    )


def test_a_copy_of_a_model_and_its_card_gives_the_same(shared, tmp_path):
    """Nothing hangs on names or places: only on the bytes of model and card."""
    shutil.copy(cards.card_path("yolox-nano"), tmp_path / "any.toml")
    shutil.copy(shared / "models" / REAL["yolox-nano"], tmp_path / "any.onnx")
    one = run(
        shared,
        [STREET],
        segments="yolox-nano",
        segmenter_weights=shared / "models" / REAL["yolox-nano"],
    )
    two = run(
        shared,
        [STREET],
        segments="any",
        segmenter_weights=tmp_path / "any.onnx",
        card=tmp_path / "any.toml",
    )
    assert schemas.digest(one) == schemas.digest(two)
