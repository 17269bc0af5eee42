"""Further annotation files, label maps and names of others, each from a public report or format.

benchmarks/foreign.md says where each comes from. What is right has its value here; what cannot be
told is a failed row or a refusal with its reason.
"""

import json

import numpy as np
import pyarrow as pa
import pytest
from click.testing import CliRunner
from PIL import Image

from rsa_data.cli.main import cli
from rsa_data.common import names_files
from rsa_data.common.errors import RsaDataError
from rsa_data.datasets.dataset import Dataset
from rsa_data.segments import detect

DATASET = Dataset("folder", lambda root, split: None, lambda path: None, 1e-3, 10)
pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")

CATEGORIES = [{"id": 1, "name": "bed"}, {"id": 2, "name": "lamp"}]
IMAGES = [{"id": 1, "file_name": "1.jpg", "width": 100, "height": 100}]
BED = {"id": 1, "image_id": 1, "category_id": 1, "bbox": [0, 0, 50, 50]}


def run(source, images=("1.jpg",), root=None, **options):
    samples = pa.table({"sample_id": images, "image": pa.array(images, pa.string())})
    sizes = pa.array([None] * len(images), pa.int32())
    samples = samples.append_column("width", sizes).append_column("height", sizes)
    step = detect.build(
        dataset=DATASET, root=root, images=lambda: list(images), segments=source, **options
    )
    return step(samples).to_pylist()


def instances(*annotations, images=IMAGES, categories=CATEGORIES):
    return {"images": images, "annotations": list(annotations), "categories": categories}


SQUARE = [[10, 20, 60, 20, 60, 70, 10, 70]]
LVIS = [{"id": 1, "coco_url": "http://x/val2017/1.jpg", "width": 100, "height": 100}]
ANNOTATIONS = {
    "ids as text": (
        instances(BED | {"image_id": "1"}, images=[IMAGES[0] | {"id": "1"}]),
        ["bed"],
        [0.25],
    ),
    "LVIS names images by coco_url": (instances(BED, images=LVIS), ["bed"], [0.25]),
    "segmentation null": (instances(BED | {"segmentation": None}), ["bed"], [0.25]),
    "segmentation {}": (instances(BED | {"segmentation": {}}), ["bed"], [0.25]),
    "no objects": (instances(), [], []),
    "a region to ignore": (instances(BED, BED | {"id": 2, "ignore": 1}), ["bed"], [0.25]),
    "iscrowd as a number of pandas": (instances(BED | {"iscrowd": 0.0}), ["bed"], [0.25]),
    "Ultralytics predictions.json": (
        [{"image_id": 1, "file_name": "1.jpg", "category_id": 65, "bbox": [0, 0, 50, 50]}
         | {"score": 0.9}],
        ["bed"],
        [0.25],
    ),
    "a box and a polygon of it": (
        instances(BED | {"bbox": [10, 20, 50, 50], "segmentation": SQUARE}), ["bed"], [0.25],
    ),
}  # fmt: skip


@pytest.mark.parametrize(("content", "labels", "areas"), ANNOTATIONS.values(), ids=ANNOTATIONS)
def test_annotations_that_are_read(tmp_path, content, labels, areas):
    (tmp_path / "a.json").write_text(json.dumps(content))
    Image.new("RGB", (100, 100)).save(tmp_path / "1.jpg")
    (row,) = run(f"coco-detections:{tmp_path / 'a.json'}", root=tmp_path)
    assert (row["error"], row["label"], row["area"]) == (None, labels, areas)


FAILED = {
    "x and y exchanged in the polygons": (
        BED | {"bbox": [70, 10, 20, 20], "segmentation": [[10, 70, 30, 70, 30, 90, 10, 90]]},
        "Are x and y exchanged",
    ),
    "a polygon of two points": (BED | {"segmentation": [[10, 10, 90, 90]]}, "three points or more"),
    "a flat list": (BED | {"segmentation": SQUARE[0]}, "three points or more"),
    "run lengths of a transposed mask": (
        BED | {"segmentation": {"size": [50, 100], "counts": [0, 5000]}},
        "mask of size",
    ),
    "neither box nor polygon": (BED | {"bbox": [], "segmentation": []}, "a segmentation, found"),
}


@pytest.mark.parametrize(("annotation", "says"), FAILED.values(), ids=FAILED)
def test_annotations_that_fail_their_row(tmp_path, annotation, says):
    (tmp_path / "a.json").write_text(json.dumps(instances(annotation)))
    (row,) = run(f"coco-detections:{tmp_path / 'a.json'}")
    assert row["status"] == "failed" and says in row["error"]


TWICE = [*IMAGES, IMAGES[0] | {"id": 2}]
REFUSED = {
    "ids as 1.0": (instances(BED | {"image_id": 1.0}), "image_id: expected a number or text"),
    "category_id as text": (instances(BED | {"category_id": "1"}), "expected a whole number"),
    "bbox null": (instances(BED | {"bbox": None}), "bbox: expected a list of numbers"),
    "scores as text": (instances(BED | {"score": "0.9"}), "score: expected a number"),
    "iscrowd as text": (instances(BED | {"iscrowd": "0"}), "iscrowd: expected 0 or 1"),
    "brush masks of CVAT": (instances(BED | {"iscrowd": 1}), "found iscrowd 1 in all 1 entries"),
    "VGG Image Annotator": (
        {"1.jpg7": {"filename": "1.jpg", "size": 7, "regions": []}},
        "expected a list of results",
    ),
    "labelme": ({"version": "5", "shapes": [], "imagePath": "1.jpg"}, "expected a list of results"),
    "CreateML": ([{"image": "1.jpg", "annotations": []}], "image_id and category_id"),
    "YouTube-VIS": (
        {"videos": [], "annotations": [{"video_id": 1, "category_id": 1, "bboxes": []}]},
        "image_id and category_id",
    ),
    "keypoint names as categories": (
        instances(BED, categories=[{"id": 1, "keypoints": ["nose"]}]),
        "name: expected a name",
    ),
}


@pytest.mark.parametrize(("content", "says"), REFUSED.values(), ids=REFUSED)
def test_annotations_that_are_refused(tmp_path, content, says):
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(RsaDataError, match=says):
        run(f"coco-detections:{tmp_path / 'a.json'}")


def test_one_file_name_under_two_ids_fails_the_row(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps(instances(BED, images=TWICE)))
    (row,) = run(f"coco-detections:{tmp_path / 'a.json'}")
    assert "found several that fit" in row["error"]


NAMES = b"background\nperson\n"
GREY = np.array([[0, 1, 1, 1]], np.uint8)


def palette(values):
    """As labelme and VOC write: indices into a colour table."""
    image = Image.frombytes("P", values.shape[::-1], values.tobytes())
    image.putpalette([v for k in range(256) for v in (k * 37 % 256, k * 91 % 256, k * 13 % 256)])
    return image


MAPS = {
    "labelme's palette": (palette(GREY), NAMES, [0.25, 0.75]),
    "colours of CVAT": (
        Image.fromarray(np.array([[[48, 112, 32]] * 4], np.uint8)), NAMES, "8 bits, RGB",
    ),
    "ADE20K's full maps": (
        Image.fromarray(np.array([[[60, 5, 1]] * 4], np.uint8)), NAMES, "8 bits, RGB",
    ),
    "with alpha": (Image.fromarray(np.array([[[1, 255]] * 4], np.uint8)), NAMES, "grey with alpha"),
    "a mask of 0 and 255": (Image.fromarray(GREY * 255), NAMES, "found 0 and 255: a mask"),
    "the same with 255 named": (
        Image.fromarray(GREY * 255), b"0: background\n255: person\n", [0.25, 0.75],
    ),
    "multiplied to be seen": (Image.fromarray(GREY * 25), NAMES, "found [25]"),
    "ids of instances": (Image.fromarray(np.array([[26001] * 4], np.uint16)), NAMES, "[26001]"),
    "resized": (Image.fromarray(np.ones((2, 2), np.uint8)), NAMES, "found 2 x 2"),
}  # fmt: skip


@pytest.mark.parametrize(("picture", "names", "wanted"), MAPS.values(), ids=MAPS)
def test_label_maps(tmp_path, picture, names, wanted):
    picture.save(tmp_path / "1.png")
    Image.new("RGB", (4, 1)).save(tmp_path / "1.jpg")
    (tmp_path / "n.txt").write_bytes(names)
    (row,) = run(f"labels:{tmp_path}", root=tmp_path, names=str(tmp_path / "n.txt"))
    if isinstance(wanted, str):
        assert row["status"] == "failed" and wanted in row["error"]
    else:
        assert (row["label"], row["area"]) == (["background", "person"], wanted)


def test_a_map_saved_as_jpeg_is_not_taken(tmp_path):
    Image.fromarray(GREY).save(tmp_path / "1.jpg")
    (row,) = run(f"labels:{tmp_path}", names="nyu13")
    assert "1.png: no such file" in row["error"]
    (tmp_path / "1.jpg").rename(tmp_path / "1.png")
    (row,) = run(f"labels:{tmp_path}", names="nyu13")
    assert "expected a PNG label map" in row["error"]


PALETTES = {
    "CVAT labelmap.txt": ("l.txt", "# label:color_rgb:parts:actions\nCat:48,112,32::\n", "line 1"),
    "the same without its first line": (
        "l.txt",
        "Background:0,215,255::\nBone:255,0,204::\n",
        "a colour",
    ),
    "CamVid label_colors.txt": ("l.txt", "64 128 64\tAnimal\n192 0 128\tArchway\n", "a colour"),
    "DIGITS' colour map": ("l.txt", "0, 0, 0\n128, 0, 0\n0, 128, 0\n", "a colour"),
    "class_dict.csv": ("l.csv", "name,r,g,b\nAnimal,64,128,64\n", "without a column of numbers"),
    "label2id": ("l.json", '{"wall": 0, "floor": 1}', "number = name"),
    "data.yaml": ("d.yaml", "names:\n  0: person\n", "a YAML file"),
    "Supervisely meta.json": ("m.json", '{"classes": [{"title": "cat"}]}', "number = name"),
    "Mapillary config.json": ("c.json", '{"labels": [{"readable": "Bird"}]}', "number = name"),
}


@pytest.mark.parametrize(("name", "text", "says"), PALETTES.values(), ids=PALETTES)
def test_palettes_are_no_names(tmp_path, name, text, says):
    (tmp_path / name).write_text(text)
    with pytest.raises(RsaDataError, match=says):
        names_files.read(tmp_path / name)


def test_results_that_were_written_for_an_evaluation_are_doubted(tmp_path):
    Image.new("RGB", (100, 100)).save(tmp_path / "1.jpg")
    result = {"image_id": 1, "category_id": 1, "bbox": [0, 0, 50, 50]}
    low = [result | {"score": 0.001 * (n + 1)} for n in range(9)]
    source, command = f"coco-detections:{tmp_path / 'r.json'}", ["detect", "--dataset", "folder:a"]
    for results, said in (
        ([*low, result | {"score": 0.9}], "9 of 10 segments have scores below 0.05"),
        ([result | {"score": 0.9}], "1 class; in most images: person 100%"),
    ):
        (tmp_path / "r.json").write_text(json.dumps(results))
        words = ["--root", str(tmp_path), "--segments", source, "--work", str(tmp_path / "w")]
        done = CliRunner().invoke(cli, [*command, *words, "--start-over"])
        assert done.exit_code == 0 and said in done.output, done.output
        assert ("scores below" in done.output) == (len(results) > 1)
