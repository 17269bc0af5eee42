"""Importers of COCO panoptic annotations and label maps: shares counted to the pixel."""

import json
import tarfile
from fractions import Fraction

import numpy as np
import pyarrow as pa
import pytest
from PIL import Image

from rsa_data.common import class_names
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


def run(source, images, root=None, **options):
    samples = pa.table({"sample_id": images, "image": pa.array(images, pa.string())})
    found = detect.build(dataset=DATASET, root=root, segments=source, **options)(samples)
    schemas.check("segments", found)
    return found.to_pylist()


def of_coco(name):
    """A COCO panoptic name as the release writes it, and its one squeezed word as two."""
    return "playing field" if name == "playingfield" else name.split("-")[0]


def write_ids(path, ids):
    ids = np.array(ids)
    Image.fromarray(np.stack([ids & 255, ids >> 8 & 255, ids >> 16], 2).astype(np.uint8)).save(path)


def write_coco(folder, infos, ids, name="a.jpg", **record):
    folder.mkdir(exist_ok=True)
    write_ids(folder / "a.png", ids)
    content = {
        "images": [{"id": 5, "file_name": name, **record}],
        "annotations": [{"image_id": 5, "file_name": "a.png", "segments_info": infos}],
        "categories": [
            {"id": 1, "name": "person", "isthing": 1},
            {"id": 171, "name": "wall-brick", "isthing": 0},
            {"id": 199, "name": "wall-other-merged", "isthing": 0},
        ],
    }
    (folder / "panoptic.json").write_text(json.dumps(content))
    return f"coco-panoptic:{folder / 'panoptic.json'}"


IDS = [[70000, 70000, 0, 3], [70000, 900, 900, 3]]
INFOS = [
    {"id": 3, "category_id": 171, "area": 2},
    {"id": 900, "category_id": 199, "area": 2},
    {"id": 70000, "category_id": 1, "area": 3},
]


def test_coco_panoptic(tmp_path):
    source = write_coco(tmp_path, INFOS, IDS, width=4, height=2)
    (found,) = run(source, ["train/a.jpg"])
    assert found == {
        "sample_id": "train/a.jpg",
        "status": "ok",
        "error": None,
        "width": 4,
        "height": 2,
        "label": ["wall", "wall", "person"],
        "score": [1.0, 1.0, 1.0],
        "area": [2 / 8, 2 / 8, 3 / 8],
        "box": [[3, 0, 4, 2], [1, 1, 3, 2], [0, 0, 2, 2]],
        "is_thing": [False, False, True],
        "center": [[3.5, 1], [2, 1.5], pytest.approx([2.5 / 3, 2.5 / 3])],
        "cell": [2, 7, 0],
        "mask": None,
        "feature": None,
    }


# pycocotools' own, with numpy 2.
@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
def test_coco_panoptic_masks_are_those_of_pycocotools(tmp_path):
    coco_mask = pytest.importorskip("pycocotools.mask")
    source = write_coco(tmp_path, INFOS, IDS)
    (found,) = run(source, ["a.jpg"], masks=True)
    decoded = [coco_mask.decode({"size": [2, 4], "counts": mask}) for mask in found["mask"]]
    for mask, info in zip(decoded, INFOS, strict=True):
        np.testing.assert_array_equal(mask, np.array(IDS) == info["id"])


@pytest.mark.parametrize(
    ("infos", "record", "reason"),
    [
        (INFOS[:2], {}, "a.png: ids of the map that the JSON does not have: 70000"),
        (
            [*INFOS, {"id": 8, "category_id": 1}],
            {},
            "a.png: ids of the JSON that the map does not have: 8",
        ),
        (
            [INFOS[0] | {"area": 3}, *INFOS[1:]],
            {},
            "a.png: segment 3: expected 3 pixels, as the JSON says, found 2",
        ),
        (
            INFOS,
            {"width": 5, "height": 2},
            "a.png: expected 5 x 2 pixels, as the JSON says, found 4 x 2",
        ),
    ],
    ids=["missing in JSON", "missing in map", "area", "size"],
)
def test_coco_panoptic_quarantines(tmp_path, infos, record, reason):
    source = write_coco(tmp_path, infos, IDS, **record)
    (found,) = run(source, ["a.jpg"])
    assert (found["status"], found["error"]) == ("failed", f"segments/coco-panoptic: {reason}")


def test_coco_panoptic_map_of_another_size_than_the_image(tmp_path):
    source = write_coco(tmp_path / "coco", INFOS, IDS)
    Image.new("RGB", (3, 2)).save(tmp_path / "a.jpg")
    (found,) = run(source, ["a.jpg"], root=tmp_path)
    assert found["error"] == (
        "segments/coco-panoptic: a.png: id map: expected the image's size 3 x 2, found 4 x 2"
    )


def test_one_record_never_stands_for_two_samples(tmp_path):
    source = write_coco(tmp_path, INFOS, IDS)
    found = run(source, ["x/a.jpg", "y/a.jpg", "y/b.jpg"])
    several = (
        "segments/coco-panoptic: panoptic.json: expected one record of the image {} and of no "
        "other image; found several that fit by their names"
    )
    assert [row["error"] for row in found] == [
        several.format("x/a.jpg"),
        several.format("y/a.jpg"),
        "segments/coco-panoptic: panoptic.json: expected a record of the image y/b.jpg, found none",
    ]


def test_coco_panoptic_without_json(tmp_path):
    with pytest.raises(RsaDataError, match="Write coco-panoptic:JSON"):
        run(f"coco-panoptic:{tmp_path}/none.json", ["a.jpg"])
    (tmp_path / "bad.json").write_text("[1]")
    with pytest.raises(RsaDataError, match="expected a list 'images'"):
        run(f"coco-panoptic:{tmp_path}/bad.json", ["a.jpg"])


def test_real_coco_panoptic_areas_equal_the_json(shared):
    folder = shared / "panoptic_coco"
    source = f"coco-panoptic:{folder / 'panoptic_examples.json'}"
    (found,) = run(source, ["000000142238.jpg"], root=folder, crowd="stuff")
    assert found["error"] is None
    content = json.loads((folder / "panoptic_examples.json").read_text())
    infos = content["annotations"][0]["segments_info"]
    assert found["area"] == [info["area"] / (640 * 427) for info in infos]
    names = {c["id"]: of_coco(c["name"]) for c in content["categories"]}
    crowds = {"person": "crowd of people", "book": "group of books"}
    assert found["label"] == [
        crowds[names[i["category_id"]]] if i["iscrowd"] else names[i["category_id"]] for i in infos
    ]
    (without,) = run(source, ["000000142238.jpg"], root=folder)
    kept = [k for k, info in enumerate(infos) if not info["iscrowd"]]
    assert 0 < len(kept) < len(infos)
    assert without["area"] == [found["area"][k] for k in kept]
    # COCO's own boxes are given as x y w h.
    boxes = [[x, y, x + w, y + h] for x, y, w, h in (info["bbox"] for info in infos)]
    assert found["box"] == boxes


def test_the_shipped_table_is_cocos(shared):
    content = json.loads((shared / "categories" / "panoptic_coco_categories.json").read_text())
    table = class_names.table("coco-panoptic")
    assert table.names == {c["id"]: of_coco(c["name"]) for c in content}
    assert table.things == {c["id"] for c in content if c["isthing"]}
    assert len(set(table.names.values())) == 127


def test_voc_style_coco_names_become_cocos(shared):
    lines = (shared / "categories" / "coco.names").read_text().split("\n")
    names = [class_names.clean(line) for line in lines if line]
    assert names == list(class_names.table("coco").names.values())


def test_label_maps(tmp_path):
    (tmp_path / "a").mkdir()
    Image.fromarray(np.array([[12, 12, 0], [5, 1, 12]], np.uint8)).save(tmp_path / "a/b.png")
    (found,) = run(f"labels:{tmp_path}", ["a/b.jpg"], names="nyu13")
    expected = {"label": ["bed", "floor", "wall"], "area": [1 / 6, 1 / 6, 3 / 6]}
    assert {key: found[key] for key in expected} == expected
    assert found["box"] == [[1, 1, 2, 2], [0, 1, 1, 2], [0, 0, 3, 2]]
    assert found["is_thing"] == [False] * 3


def test_label_maps_with_a_palette_keep_their_numbers(tmp_path):
    image = Image.fromarray(np.array([[0, 2]], np.uint8), "P")
    image.putpalette([9, 9, 9] * 256)
    image.save(tmp_path / "x_7.png")
    (tmp_path / "names.txt").write_text("sky\nroad\ntree_(plant)\n")
    where = f"labels:{tmp_path}/x_{{number}}.png"
    (found,) = run(where, ["frame_0007.jpg"], names=str(tmp_path / "names.txt"))
    assert list(zip(found["label"], found["area"], strict=True)) == [("sky", 0.5), ("tree", 0.5)]


@pytest.mark.parametrize(
    ("pixels", "reason"),
    [
        ([[1, 77]], "b.png: expected class numbers of the table, found [77]"),
        (
            [[[1, 2, 3]]],
            "b.png: expected a label map of one channel, found a PNG of 8 bits, RGB",
        ),
        (None, "b.png: no such file"),
    ],
)
def test_bad_label_maps_are_quarantined(tmp_path, pixels, reason):
    if pixels is not None:
        Image.fromarray(np.array(pixels, np.uint8)).save(tmp_path / "b.png")
    (found,) = run(f"labels:{tmp_path}", ["b.jpg"], names="nyu13")
    assert (found["status"], found["error"]) == ("failed", f"segments/labels: {reason}")


def test_wrong_calls(tmp_path):
    with pytest.raises(UsageError, match="say by --names"):
        run(f"labels:{tmp_path}", [])
    with pytest.raises(UsageError, match="Did you mean 'nyu13'"):
        run(f"labels:{tmp_path}", [], names="nyu31")
    with pytest.raises(UsageError, match="--features has no effect here"):
        run(f"labels:{tmp_path}", [], names="nyu13", features="x")
    with pytest.raises(UsageError, match=r"expected the fields path, stem"):
        run(f"labels:{tmp_path}/{{stern}}.png", [], names="nyu13")


def test_500_real_label_maps(shared, tmp_path):
    archive = shared / "nyuv2_labels" / "nyuv2_test_class13_first500.tar.gz"
    with tarfile.open(archive) as tar:
        tar.extractall(tmp_path, filter="data")
    paths = sorted(tmp_path.rglob("*.png"))
    assert len(paths) == 500
    images = [f"rgb_{int(path.stem[-4:]) - 1:05}.jpg" for path in paths]
    where = f"labels:{paths[0].parent}/new_nyu_class13_{{next:04}}.png"
    found = run(where, images, names="nyu13")
    names = class_names.table("nyu13").names
    for row, path in zip(found, paths, strict=True):
        pixels = np.bincount(np.asarray(Image.open(path)).ravel(), minlength=14).tolist()
        pixels = {n: count for n, count in enumerate(pixels) if count}
        total = sum(pixels.values())
        shares = [Fraction(pixels[n], total) for n in sorted(pixels) if n in names]
        assert row["label"] == [names[n] for n in sorted(pixels) if n in names]
        assert row["area"] == [float(share) for share in shares]
