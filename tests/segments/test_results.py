"""Importers of COCO detection results and Cityscapes instance maps."""

import json

import numpy as np
import pyarrow as pa
import pytest
from PIL import Image

from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.datasets.dataset import Dataset
from rsa_data.segments import detect
from rsa_data.store import schemas

DATASET = Dataset(
    "folder",
    index=lambda root, split: None,
    read_depth=lambda path: None,
    min_depth=1e-3,
    max_depth=10,
)

# pycocotools' own, with numpy 2.
pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")


def run(source, images, width=10, height=8, root=None, **options):
    count = len(images)
    samples = pa.table(
        {
            "sample_id": images,
            "image": images,
            "width": pa.array([width] * count, pa.int32()),
            "height": pa.array([height] * count, pa.int32()),
        }
    )
    found = detect.build(dataset=DATASET, root=root, segments=source, **options)(samples)
    schemas.check("segments", found)
    return found.to_pylist()


def write(path, content):
    path.write_text(json.dumps(content))
    return f"coco-detections:{path}"


RESULTS = [
    {"image_id": 7, "category_id": 1, "bbox": [1, 2, 3, 4], "score": 0.5},
    {"image_id": 7, "category_id": 90, "bbox": [-1, -1, 12, 10], "score": 0.9},
    {"image_id": 8, "category_id": 3, "bbox": [0, 0, 5, 8], "score": 0.2},
]


def test_boxes(tmp_path):
    source = write(tmp_path / "r.json", RESULTS)
    found = run(source, ["a/000007.jpg", "a/000008.jpg", "a/000009.jpg"])
    assert [row["label"] for row in found] == [["toothbrush", "person"], ["car"], []]
    assert found[2]["error"] == (
        "segments/coco-detections: r.json: expected a result (or a record in JSON:IMAGES) of the "
        "image a/000009.jpg, found none"
    )
    assert found[0]["box"] == [[0, 0, 10, 8], [1, 2, 4, 6]]
    assert found[0]["area"] == [1.0, 12 / 80]
    assert found[0]["score"] == [pytest.approx(0.9), 0.5]
    found = run(source, ["000007.jpg"], score_threshold=0.6)
    assert found[0]["label"] == ["toothbrush"]


def mask(shape=(8, 10)):
    values = np.zeros(shape, np.uint8)
    values[2:5, 3:9] = 1
    values[3, 4] = 0
    return values


@pytest.mark.parametrize("form", ["compressed", "counts", "polygons"])
def test_masks(tmp_path, form):
    from pycocotools import mask as coco_mask

    encoded = coco_mask.encode(np.asfortranarray(mask()))
    if form == "compressed":
        segmentation = encoded | {"counts": encoded["counts"].decode()}
        pixels = 17
    elif form == "counts":
        flat = np.concatenate([[0], mask().ravel(order="F"), [2]])
        edges = np.flatnonzero(np.diff(flat))
        segmentation = {"size": [8, 10], "counts": np.diff([0, *edges]).tolist()}
        pixels = 17
    else:
        segmentation, pixels = [[3, 2, 9, 2, 9, 5, 3, 5]], 18
    result = {"image_id": 7, "category_id": 62, "segmentation": segmentation, "score": 1.0}
    (found,) = run(write(tmp_path / "r.json", [result]), ["7.png"], masks=True)
    assert found["error"] is None
    assert (found["label"], found["area"]) == (["chair"], [pixels / 80])
    assert found["box"] == [[3, 2, 9, 5]]
    decoded = coco_mask.decode({"size": [8, 10], "counts": found["mask"][0]})
    assert decoded.sum() == pixels


@pytest.mark.parametrize(
    ("result", "reason"),
    [
        (
            {"segmentation": {"size": [10, 8], "counts": [80]}},
            "mask of size [10, 8]: expected the image's [8, 10]",
        ),
        ({"segmentation": "circle"}, "expected a segmentation as polygons or RLE, found 'circle'"),
    ],
)
def test_bad_results_are_quarantined(tmp_path, result, reason):
    result = {"image_id": 7, "category_id": 1, "score": 1.0} | result
    (found,) = run(write(tmp_path / "r.json", [result]), ["7.png"])
    assert found["status"] == "failed"
    assert found["error"].startswith(f"segments/coco-detections: image 7: {reason}")


def test_a_file_of_another_form_is_refused_whole(tmp_path):
    result = {"image_id": 7, "category_id": 1, "score": 1.0, "bbox": [1, 2, 3]}
    (found,) = run(write(tmp_path / "r.json", [result]), ["7.png"])
    assert "expected bbox = [x, y, w, h] or a segmentation, found {" in found["error"]
    with pytest.raises(RsaDataError, match=r"results\[0\].bbox: expected a list of numbers"):
        run(write(tmp_path / "r.json", [result | {"bbox": "1 2 3 4"}]), ["7.png"])


def test_annotations_bring_images_sizes_and_classes(tmp_path):
    annotations = {
        "images": [{"id": "x1", "file_name": "val/left.png", "width": 20, "height": 4}],
        "annotations": [{"image_id": "x1", "category_id": 5, "bbox": [0, 0, 10, 4]}],
        "categories": [{"id": 5, "name": "swivel_chair"}],
    }
    source = write(tmp_path / "a.json", annotations)
    found = run(source, ["data/val/left.jpg", "data/val/right.jpg"])
    assert (found[0]["label"], found[0]["area"], found[0]["score"]) == (
        ["swivel chair"],
        [0.5],
        [1],
    )
    assert found[1]["error"] == (
        "segments/coco-detections: a.json: expected a record of the image data/val/right.jpg, "
        "found none"
    )
    results = [{"image_id": "x1", "category_id": 5, "bbox": [0, 0, 5, 4], "score": 0.5}]
    source = write(tmp_path / "r.json", results) + f":{tmp_path / 'a.json'}"
    assert run(source, ["val/left.jpg"])[0]["area"] == [0.25]
    assert set(detect.files(segments=source)) == {"results", "images"}


def test_sizes_come_from_the_images(tmp_path):
    Image.new("RGB", (50, 40)).save(tmp_path / "7.png")
    source = write(tmp_path / "r.json", RESULTS)
    (found,) = run(source, ["7.png"], width=None, height=None, root=tmp_path)
    assert (found["width"], found["height"], found["area"]) == (50, 40, [99 / 2000, 12 / 2000])
    (found,) = run(source, ["7.png"], width=None, height=None)
    assert "the image's size is not known; give the dataset's root" in found["error"]


def test_wrong_files(tmp_path):
    with pytest.raises(UsageError, match="write coco-detections:JSON or"):
        run("coco-detections", [])
    with pytest.raises(RsaDataError, match="expected a JSON file at"):
        run(f"coco-detections:{tmp_path}/none.json", [])
    with pytest.raises(RsaDataError, match="expected a list of results with image_id"):
        run(write(tmp_path / "r.json", [{"bbox": [1, 2, 3, 4]}]), [])


def test_cityscapes(tmp_path):
    ids = np.zeros((8, 10), np.uint16)
    ids[:2] = 23  # sky
    ids[2:4] = 7  # road
    ids[4:, :5] = 26001  # a car
    ids[4:, 5:7] = 26002  # another
    ids[4:, 7:] = 26  # a group of cars
    ids[7] = 3  # out of the region of interest: void
    folder = tmp_path / "gtFine" / "val" / "ulm"
    folder.mkdir(parents=True)
    Image.fromarray(ids).save(folder / "a_gtFine_instanceIds.png")
    source = f"cityscapes:{tmp_path / 'gtFine'}"
    images = ["leftImg8bit/val/ulm/a_leftImg8bit.png", "val/ulm/b_leftImg8bit.png", "a.png"]
    found = run(source, images)
    assert found[0]["label"] == ["road", "sky", "car", "car"]
    assert found[0]["area"] == [20 / 80, 20 / 80, 15 / 80, 6 / 80]
    assert found[0]["is_thing"] == [False, False, True, True]
    with_group = run(source, images, crowd="stuff")[0]
    assert with_group["label"] == ["road", "sky", "group of cars", "car", "car"]
    assert with_group["area"][2] == 9 / 80 and not with_group["is_thing"][2]
    assert [row["error"] for row in found[1:]] == [
        "segments/cityscapes: val/ulm/b_gtFine_instanceIds.png: no such file",
        "segments/cityscapes: expected an image .../SPLIT/CITY/x_leftImg8bit.png, found a.png",
    ]
    Image.fromarray(np.full((8, 10), 34001, np.uint16)).save(folder / "b_gtFine_instanceIds.png")
    assert run(source, images)[1]["error"].endswith("expected label ids up to 33, found [34]")
    with pytest.raises(RsaDataError, match="expected the folder gtFine"):
        run("cityscapes:none", [])
