"""Annotation files as other programs write them: partners, sizes, frames, classes, crowds.

The situations come from public reports; benchmarks/foreign.md lists them.
"""

import json
import unicodedata

import numpy as np
import pyarrow as pa
import pytest
from PIL import Image

from rsa_data.common.errors import RsaDataError
from rsa_data.datasets.dataset import Dataset
from rsa_data.segments import detect

DATASET = Dataset("folder", lambda root, split: None, lambda path: None, 1e-3, 10)

# pycocotools' own, with numpy 2.
pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")

CATEGORIES = [{"id": 1, "name": "bed"}, {"id": 2, "name": "T-shirt"}, {"id": 3, "name": "person"}]


def run(source, images, *, root=None, size=(100, 100), others=(), **options):
    """Rows of a part with these images; others : images of other parts of the dataset."""
    samples = pa.table(
        {
            "sample_id": images,
            "image": pa.array(images, pa.string()),
            "width": pa.array([size and size[0]] * len(images), pa.int32()),
            "height": pa.array([size and size[1]] * len(images), pa.int32()),
        }
    )
    whole = [*images, *others]
    step = detect.build(
        dataset=DATASET, root=root, images=lambda: whole, segments=source, **options
    )
    return step(samples).to_pylist()


def coco(path, annotations, images=None, categories=CATEGORIES, **image):
    """An instances file; annotations : of image 1 unless they say another."""
    listed = images or [{"id": 1, "file_name": "1.jpg", "width": 100, "height": 100, **image}]
    annotations = [{"id": k, "image_id": 1, **a} for k, a in enumerate(annotations, 1)]
    content = {"images": listed, "annotations": annotations, "categories": categories}
    path.write_text(json.dumps(content))
    return f"coco-detections:{path}"


def results(path, entries):
    path.write_text(json.dumps([{"category_id": 1, "score": 0.9, **e} for e in entries]))
    return f"coco-detections:{path}"


BOX = {"category_id": 1, "bbox": [0, 0, 50, 50]}


def photo(path, size, orientation=1):
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.new("RGB", size, (90, 90, 90)).save(path, exif=exif)


@pytest.mark.parametrize(
    ("image_id", "image"),
    [
        (42, "val/COCO_val2014_000000000042.jpg"),
        (42, "000042.png"),
        ("42", "42.jpg"),
        ("left", "a/left.jpg"),
        ("left.jpg", "a/left.jpg"),
        ("a/left", "a/left.jpg"),
        ("cam1_0007", "cam1_0007.jpg"),
        (1305031102, "1305031102.jpg"),
    ],
)
def test_result_ids_of_each_kind(tmp_path, image_id, image):
    source = results(tmp_path / "r.json", [{"image_id": image_id, "bbox": [0, 0, 50, 50]}])
    (row,) = run(source, [image])
    assert (row["label"], row["area"]) == (["person"], [0.25])


def test_no_result_is_given_to_two_images_of_any_part(tmp_path):
    source = results(tmp_path / "r.json", [{"image_id": 1, "bbox": [0, 0, 50, 50]}])
    (row,) = run(source, ["a/0001.jpg"], others=["b/0001.jpg"])
    assert row["status"] == "failed" and "of no other image" in row["error"]


def test_results_of_another_dataset_are_refused(tmp_path):
    source = results(tmp_path / "r.json", [{"image_id": k, "bbox": [0, 0, 9, 9]} for k in (1, 2)])
    with pytest.raises(RsaDataError, match="none that belongs to any of them"):
        run(source, ["000397133.jpg", "000037777.jpg"])
    with pytest.raises(RsaDataError, match=r"1 of 2 ids that belong to none: 2.*JSON:IMAGES"):
        run(source, ["1.jpg", "000397133.jpg"])


def test_results_whose_ids_the_image_list_does_not_have_are_refused(tmp_path):
    coco(tmp_path / "i.json", [], [{"id": 10, "file_name": "1.jpg"}])
    source = results(tmp_path / "r.json", [{"image_id": 1, "bbox": [0, 0, 9, 9]}])
    with pytest.raises(RsaDataError, match="1 that it does not list: 1"):
        run(f"{source}:{tmp_path / 'i.json'}", ["1.jpg"])


@pytest.mark.parametrize(
    ("name", "image"),
    [
        ("train2017/a1.jpg", "a1.jpg"),
        ("a1.jpg", "deep/train2017/a1.jpg"),
        ("images\\b2.jpg", "b2.jpg"),
        ("C:\\data\\images\\b2.jpg", "images/b2.jpg"),
        ("/home/someone/set/b2.jpg", "b2.jpg"),
        (unicodedata.normalize("NFD", "café.jpg"), "café.jpg"),
        ("a.b.c.jpg", "a.b.c.png"),
        ("frame.001", "frame.001.jpg"),
        ("./x/1.png", "x/1.jpg"),
        ("a1_jpg.rf.0123abcd.jpg", "train/a1_jpg.rf.0123abcd.jpg"),
    ],
)
def test_file_names_of_each_form(tmp_path, name, image):
    source = coco(tmp_path / "a.json", [BOX], file_name=name)
    (row,) = run(source, [image])
    assert (row["error"], row["label"]) == (None, ["bed"])


@pytest.mark.parametrize(
    ("name", "image"),
    [("bathroom/1.jpg", "kitchen/1.jpg"), ("frame.001.jpg", "frame.002.jpg"), ("11.jpg", "1.jpg")],
)
def test_file_names_that_are_not_the_images(tmp_path, name, image):
    source = coco(tmp_path / "a.json", [BOX], file_name=name)
    with pytest.raises(RsaDataError, match="none that belongs"):
        run(source, [image])


def test_the_same_name_with_two_endings_goes_by_the_ending(tmp_path):
    images = [
        {"id": k, "file_name": f"a.{end}", "width": 100, "height": 100}
        for k, end in ((1, "jpg"), (2, "png"))
    ]
    other = {"image_id": 2, "category_id": 2, "bbox": [0, 0, 20, 50]}
    source = coco(tmp_path / "a.json", [BOX, other], images)
    rows = run(source, ["a.jpg", "a.png"])
    assert [row["label"] for row in rows] == [["bed"], ["T-shirt"]]


STORED, TURNED = {"width": 60, "height": 40}, {"width": 40, "height": 60}
SIZES = {
    "as displayed": (6, [0, 0, 40, 60], TURNED, [1.0]),
    "stored, boxes fit the display only": (6, [0, 30, 40, 30], STORED, [0.5]),
    "stored, boxes fit the file only": (6, [30, 0, 30, 40], STORED, [0.5]),
    "stored, boxes fit both": (6, [0, 0, 20, 20], STORED, "cannot be told"),
    "upside down": (3, [0, 0, 20, 20], STORED, "cannot be told"),
    "transposed": (1, [0, 0, 20, 20], TURNED, "which is transposed"),
    "another size": (1, [0, 0, 9, 9], {"width": 120, "height": 80}, "the image's size 60 x 40"),
    "no size in the record": (1, [0, 0, 30, 40], {}, [0.5]),
}


@pytest.mark.parametrize(("turn", "box", "record", "wanted"), SIZES.values(), ids=SIZES)
def test_sizes_and_frames(tmp_path, turn, box, record, wanted):
    photo(tmp_path / "1.jpg", (60, 40), turn)
    image = {"id": 1, "file_name": "1.jpg"} | record
    source = coco(tmp_path / "a.json", [{"category_id": 1, "bbox": box}], [image])
    (row,) = run(source, ["1.jpg"], root=tmp_path, size=None)
    if isinstance(wanted, str):
        assert row["status"] == "failed" and wanted in row["error"]
    else:
        assert (row["error"], row["area"]) == (None, wanted)
        assert (row["width"], row["height"]) == ((60, 40) if turn < 5 else (40, 60))


def test_boxes_of_the_stored_frame_are_turned_with_the_image(tmp_path):
    photo(tmp_path / "1.jpg", (60, 40), 6)  # 90 degrees clockwise for display
    image = {"id": 1, "file_name": "1.jpg", "width": 60, "height": 40}
    source = coco(tmp_path / "a.json", [{"category_id": 1, "bbox": [50, 0, 10, 10]}], [image])
    (row,) = run(source, ["1.jpg"], root=tmp_path, size=None)
    # The stored frame's top right corner is the displayed one's bottom right.
    assert row["box"] == [[30, 50, 40, 60]]
    assert row["cell"] == [8]


BAD_BOXES = {
    "corners": ([40, 40, 90, 90], "it would be one as [x1, y1, x2, y2]"),
    "negative": ([10, 10, -5, 20], "expected boxes [x, y, width, height]"),
    "far outside": ([0, 0, 5000, 50], "inside 100 x 100 px"),
}


@pytest.mark.parametrize(("box", "says"), BAD_BOXES.values(), ids=BAD_BOXES)
def test_boxes_that_the_image_cannot_have(tmp_path, box, says):
    source = coco(tmp_path / "a.json", [{"category_id": 1, "bbox": box}])
    (row,) = run(source, ["1.jpg"])
    assert row["status"] == "failed" and says in row["error"]


def test_boxes_a_little_over_the_border_are_clipped(tmp_path):
    source = coco(tmp_path / "a.json", [{"category_id": 1, "bbox": [-1.5, 0, 50, 101]}])
    (row,) = run(source, ["1.jpg"])
    assert row["box"] == [[0, 0, 48.5, 100]]


@pytest.mark.parametrize(
    ("annotation", "says"),
    [
        ({"category_id": 1, "bbox": [0.1, 0.2, 0.3, 0.4]}, "shares of the image, as YOLO"),
        ({"category_id": 0, "bbox": [0, 0, 9, 9]}, r"found 0 in 1 of 1.*larger by 1"),
        ({"category_id": 4, "bbox": [0, 0, 9, 9]}, r"found 4 in 1 of 1.*smaller by 1"),
        ({"category_id": 99, "bbox": [0, 0, 9, 9]}, "found 99"),
        ({"category_id": 1, "bbox": [float("nan"), 0, 9, 9]}, "a list of numbers"),
    ],
    ids=["shares", "counted from 0", "counted from 1", "unknown", "nan"],
)
def test_files_that_speak_of_something_else_are_refused(tmp_path, annotation, says):
    with pytest.raises(RsaDataError, match=says):
        run(coco(tmp_path / "a.json", [annotation]), ["1.jpg"])


@pytest.mark.parametrize("key", ["images", "categories"])
def test_an_id_stands_once(tmp_path, key):
    twice = {
        "images": {"images": [{"id": 1, "file_name": n} for n in ("1.jpg", "2.jpg")]},
        "categories": {"categories": [*CATEGORIES, {"id": 1, "name": "sofa"}]},
    }[key]
    with pytest.raises(RsaDataError, match=f"{key}: id: expected each once, found several of 1"):
        run(coco(tmp_path / "a.json", [BOX], **twice), ["1.jpg"])


def test_polygons_for_some_and_boxes_for_others(tmp_path):
    polygon = [[50, 50, 90, 50, 90, 90, 50, 90]]
    annotations = [
        BOX | {"segmentation": []},
        {"category_id": 2, "bbox": [50, 50, 40, 40], "segmentation": polygon},
    ]
    (row,) = run(coco(tmp_path / "a.json", annotations), ["1.jpg"])
    assert (row["label"], row["area"]) == (["bed", "T-shirt"], [0.25, 0.16])


def test_polygons_in_shares_fail_the_row(tmp_path):
    shares = {"category_id": 1, "bbox": [0, 0, 50, 50], "segmentation": [[0, 0, 0.5, 0, 0.5, 0.5]]}
    (row,) = run(coco(tmp_path / "a.json", [shares]), ["1.jpg"])
    assert "expected points in px, found shares" in row["error"]


@pytest.mark.parametrize(
    ("crowd", "wanted"),
    [("omit", (["bed"], [True])), ("stuff", (["bed", "crowd of people"], [True, False]))],
)
def test_crowds(tmp_path, crowd, wanted):
    counts = [0, 900, 9100]  # nine columns of 100
    region = {"size": [100, 100], "counts": counts}
    many = {"category_id": 3, "iscrowd": 1, "segmentation": region, "bbox": [0, 0, 9, 100]}
    source = coco(tmp_path / "a.json", [BOX | {"score": 1.0}, many | {"score": 0.5}])
    (row,) = run(source, ["1.jpg"], crowd=crowd)
    assert (row["label"], row["is_thing"]) == wanted
    assert row["area"][1:] == ([0.09] if crowd == "stuff" else [])


def write_panoptic(folder, ids, infos, name="1.png"):
    folder.mkdir(parents=True, exist_ok=True)
    ids = np.array(ids)
    pixels = np.stack([ids & 255, ids >> 8 & 255, ids >> 16], 2).astype(np.uint8)
    Image.fromarray(pixels).save(folder / "1.png")
    content = {
        "images": [{"id": 1, "file_name": "images\\1.jpg"}],
        "annotations": [{"image_id": 1, "file_name": name, "segments_info": infos}],
        "categories": CATEGORIES,
    }
    (folder / "p.json").write_text(json.dumps(content))
    return f"coco-panoptic:{folder / 'p.json'}"


def test_one_segment_id_with_two_classes_fails_the_row(tmp_path):
    infos = [{"id": 5, "category_id": 1}, {"id": 5, "category_id": 2}]
    (row,) = run(write_panoptic(tmp_path, [[5, 5]], infos), ["1.jpg"])
    assert "expected each segment id once, found several of 5" in row["error"]


def test_panoptic_paths_of_windows(tmp_path):
    source = write_panoptic(tmp_path / "x", [[5, 5]], [{"id": 5, "category_id": 1}], "x\\1.png")
    (tmp_path / "x" / "p.json").rename(tmp_path / "p.json")
    (row,) = run(source.replace("/x/", "/"), ["1.jpg"])
    assert (row["error"], row["label"]) == (None, ["bed"])


def label_map(path, values, bits, palette):
    """A PNG of so many bits a pixel, written by OpenCV's and Pillow's own encoders."""
    image = Image.fromarray(np.array(values, np.uint16 if bits == 16 else np.uint8))
    if palette:
        image = image.convert("L")
        image = Image.frombytes("P", image.size, image.tobytes())
        image.putpalette([7 * k % 256 for k in range(768)])
        image.save(path, bits=bits)
    elif bits in (8, 16):
        image.save(path)
    else:
        path.write_bytes(grey_png(values, bits))


def grey_png(values, bits):
    """A grey PNG of 1, 2 or 4 bits by the format's own description (PNG 1.2)."""
    import struct
    import zlib

    rows = b""
    for row in values:
        text = "".join(f"{value:0{bits}b}" for value in row)
        text += "0" * (-len(text) % 8)
        rows += b"\0" + bytes(int(text[k : k + 8], 2) for k in range(0, len(text), 8))

    def chunk(kind, data):
        crc = zlib.crc32(kind + data)
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", crc)

    head = struct.pack(">IIBBBBB", len(values[0]), len(values), bits, 0, 0, 0, 0)
    body = chunk(b"IDAT", zlib.compress(rows))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + body + chunk(b"IEND", b"")


@pytest.mark.parametrize("palette", [False, True], ids=["grey", "palette"])
@pytest.mark.parametrize("bits", [1, 2, 4, 8, 16])
def test_label_maps_of_every_png_kind(tmp_path, bits, palette):
    if palette and bits == 16:
        pytest.skip("PNG has no palette of 16 bits")
    most = min(2**bits, 300) - 1
    label_map(tmp_path / "1.png", [[0, 1, most, most]], bits, palette)
    (tmp_path / "n.txt").write_text("".join(f"class {k}\n" for k in range(300)))
    (row,) = run(f"labels:{tmp_path}", ["1.jpg"], size=None, names=str(tmp_path / "n.txt"))
    shares = {"class 0": 0.25, "class 1": 0.75} if most == 1 else None
    shares = shares or {"class 0": 0.25, "class 1": 0.25, f"class {most}": 0.5}
    assert dict(zip(row["label"], row["area"], strict=True)) == shares


def test_a_label_map_belongs_to_one_image(tmp_path):
    Image.new("L", (4, 4), 1).save(tmp_path / "7.png")
    source = f"labels:{tmp_path}/{{number}}.png"
    (row,) = run(source, ["a/7.jpg"], others=["b/7.jpg"], size=None, names="nyu13")
    assert "expected one image of this label map, found 2" in row["error"]


def test_a_transposed_label_map_is_named(tmp_path):
    Image.new("L", (4, 6), 1).save(tmp_path / "1.png")
    Image.new("RGB", (6, 4)).save(tmp_path / "1.jpg")
    (row,) = run(f"labels:{tmp_path}", ["1.jpg"], root=tmp_path, size=None, names="nyu13")
    assert "found 4 x 6, which is transposed" in row["error"]
