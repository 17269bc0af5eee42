"""The smallest inputs that benchmarks/fuzz.py found, one each."""

import json

import numpy as np
import pytest
import rooms
from coco_files import PANOPTIC, RESULTS, SAMPLES
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from rsa_data import registry
from rsa_data.common import cards, class_names
from rsa_data.common.errors import RowError, RsaDataError
from rsa_data.common.units import parse_size
from rsa_data.datasets.folder import folder
from rsa_data.datasets.listing import inside
from rsa_data.runner import status
from rsa_data.segments import coco_detections, coco_panoptic, detect, graph, masks
from rsa_data.store import schemas

SMALL_PANOPTIC = {"id": 1, "file_name": "a.jpg", "width": 4, "height": 3}


@pytest.mark.parametrize(
    ("images", "names"),
    [
        ([{**SMALL_PANOPTIC, "file_name": ""}], "bed"),
        ([{**SMALL_PANOPTIC, "file_name": "\ud800.jpg"}], "bed"),
        ([{**SMALL_PANOPTIC, "file_name": "a" * 300}], "bed"),
        ([SMALL_PANOPTIC], "\ud800"),
    ],
    ids=["no-name", "surrogate-file", "long-name", "surrogate-class"],
)
@pytest.mark.parametrize("kind", [coco_panoptic, coco_detections])
def test_coco_names_that_no_file_has(tmp_path, images, names, kind):
    content = {**PANOPTIC, "images": images, "categories": [{"id": 1, "name": names}]}
    content |= {"annotations": RESULTS["annotations"] if kind is coco_detections else []}
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(RsaDataError, match=r"a.json.*expected (a path|a name of .*), found"):
        kind.build(argument=str(tmp_path / "a.json"), dataset=folder(), root=None)


def test_coco_panoptic_with_a_width_alone(tmp_path):
    content = {**PANOPTIC, "images": [{"id": 1, "file_name": "a.jpg", "width": 3}]}
    (tmp_path / "a.json").write_text(json.dumps(content))
    Image.fromarray(np.zeros((3, 4, 3), np.uint8)).save(tmp_path / "a.png")
    step = coco_panoptic.build(argument=str(tmp_path / "a.json"), dataset=folder(), root=None)
    assert (
        "expected 3 x ? pixels, as the JSON says, found 4 x 3" in step(SAMPLES)["error"][0].as_py()
    )


@pytest.mark.parametrize(
    "segmentation",
    [
        [[0, 0, 1e9, 0, 1e9, 1e9]],  # pycocotools took 6 GB
        [[0, 0, float("nan"), 0, 1, 1]],
        {"size": [3, 4], "counts": [5]},  # pycocotools left the rest as memory held it
        {"size": [3, 4], "counts": "5"},
        {"size": [3, 4], "counts": ""},
    ],
    ids=["far", "nan", "short-list", "short-text", "empty"],
)
def test_coco_masks_that_do_not_fit(segmentation):
    pytest.importorskip("pycocotools")
    table = class_names.table("coco-panoptic")
    result = {"image_id": 1, "category_id": 1, "segmentation": segmentation}
    with pytest.raises(RowError, match=r"polygon: |run lengths: |RLE"):
        coco_detections.segments([result], {"width": 4, "height": 3}, None, table)


@given(mask=st.binary(min_size=12, max_size=12), wide=st.integers(1, 40))
@settings(deadline=None)
def test_covered_is_the_size_of_what_pycocotools_writes(mask, wide):
    coco_mask = pytest.importorskip("pycocotools.mask")
    pixels = np.repeat(np.frombuffer(mask, np.uint8).reshape(3, 4) & 1, wide, axis=1)
    counts = coco_mask.encode(np.asfortranarray(pixels))["counts"]
    assert masks.covered(counts) == masks.covered(counts.decode()) == pixels.size


@pytest.mark.parametrize("name", ["a" * 300, "b/" * 2000 + "c", "a\0b", ""])
def test_paths_that_no_file_system_has(name):
    with pytest.raises(RsaDataError, match="expected a path below"):
        inside(name, "list.txt line 1")


CARD = """
[input]
name = "images"
resize = "stretch"
size = [416, 416]
[output]
predictions = "output"
[decoder]
family = "yolox"
score_threshold = 0.3
overlap_threshold = 0.45
[classes]
table = "coco"
"""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[416, 416]", "[416]"),
        ("[416, 416]", "[416, 99999]"),
        ("[416, 416]", "[416, 416]\nmean = [1, 2]"),
        ("[416, 416]", "[416, 416]\nstd = [1, 0, 1]"),
        ('"images"', "3"),
        ("0.45", '"x"'),
        ('"coco"', "[1]"),
        ('table = "coco"', "names = [1]"),
        ('table = "coco"', 'names = ["a"]\nfirst = "x"'),
        ('table = "coco"', 'names = ["a"]\nthings = [[]]'),
        ('table = "coco"', "[classes.names]\n99999999999 = 'a'"),
    ],
)
def test_model_cards_with_values_of_another_kind(tmp_path, old, new):
    (tmp_path / "a.toml").write_text(CARD.replace(old, new))
    with pytest.raises(RsaDataError, match="model card a"):
        card = cards.read_card(tmp_path / "a.toml")
        graph.load(card, tmp_path / "none.onnx", table=graph.class_table(card))


def test_values_of_options_that_nobody_means():
    with pytest.raises(RsaDataError, match="expected a size"):
        parse_size("1" * 400, "--memory-limit")
    with pytest.raises(RsaDataError):
        registry.build("tokenizer", registry.TOKENIZERS, "hf:" + "a" * 5000)


@pytest.mark.parametrize("content", [b"[]", b"3", b'{"part": 0}', b"\xe1", b"[" * 100_000])
@pytest.mark.parametrize("name", ["_table.json", "_part-00000.json", "_manifest.json"])
def test_files_of_a_table_that_somebody_changed(tmp_path, content, name):
    table = rooms.made(tmp_path, parts=1, rows=2).table("rooms", "samples")
    (tmp_path / "rooms" / "samples" / name).write_bytes(content)
    with pytest.raises(RsaDataError, match=name.replace(".", r"\.")):
        table.description(), table.receipt(0), table.stored_manifest()


def test_inputs_that_lead_back_to_their_table(tmp_path):
    work = rooms.made(tmp_path, parts=1, rows=2)
    path = tmp_path / "rooms" / "segments" / "labels" / "_table.json"
    changes = {"inputs": ["segments/labels"], "stage_version": detect.STAGE.version}
    changes["schema_version"] = schemas.definition("segments")["version"]
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))
    (told,) = status.status(work).broken
    assert "its inputs lead back to it" in told


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("tokenizer.json", "-0.5", "expected a tokenizer"),
        ("config.json", '{"max_position_embeddings": "nan"}', "expected a whole number"),
        ("config.json", '{"text_config": 3}', "expected an object"),
        ("config.json", "[]", "expected an object"),
        ("sentence_bert_config.json", '{"max_seq_length": "x"}', "max_seq_length"),
    ],
)
def test_model_folders_that_somebody_changed(tmp_path, name, content, words):
    tokenizers = pytest.importorskip("tokenizers")
    made = tokenizers.Tokenizer(tokenizers.models.WordLevel({"a": 0}, unk_token="a"))
    files = {"tokenizer.json": made.to_str(), "config.json": '{"max_position_embeddings": 9}'}
    for file, text in {**files, name: content}.items():
        (tmp_path / file).write_text(text)
    with pytest.raises(RsaDataError, match=words):
        registry.build("tokenizer", registry.TOKENIZERS, f"hf:{tmp_path}")


def test_a_tokenizer_that_panics(tmp_path):
    tokenizers = pytest.importorskip("tokenizers")
    made = tokenizers.Tokenizer(tokenizers.models.WordLevel({"a": 0}, unk_token="a"))
    ends = [("[CLS]", 0)]
    made.post_processor = tokenizers.processors.TemplateProcessing("[CLS] $A", None, ends)
    text = made.to_str().replace('{"id":"[CLS]","type_id"', '{"id":"[SEP]","type_id"')
    (tmp_path / "tokenizer.json").write_text(text)
    (tmp_path / "config.json").write_text('{"max_position_embeddings": 9}')
    with pytest.raises(RsaDataError, match=r"tokenizer\.json"):
        registry.build("tokenizer", registry.TOKENIZERS, f"hf:{tmp_path}").count(["a"])


def test_a_receipt_cannot_name_a_file_elsewhere(tmp_path):
    table = rooms.made(tmp_path, parts=1, rows=2).table("rooms", "samples")
    path = tmp_path / "rooms" / "samples" / "_part-00000.json"
    path.write_text(json.dumps({**json.loads(path.read_bytes()), "file": "../../../etc/passwd"}))
    with pytest.raises(RsaDataError, match="file: expected a file's name"):
        table.read(0)
