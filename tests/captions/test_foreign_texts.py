"""Files of texts as other programs and datasets write them; benchmarks/foreign.md lists them."""

import json

import pytest

from rsa_data.captions import write
from rsa_data.common import options
from rsa_data.common.errors import RsaDataError
from rsa_data.store import schemas

A, B = "rooms/1000268201_693b08cb0e.jpg", "rooms/000000000042.jpg"


def imported(path, images=(A, B), others=(), splits=None):
    """(image, text) in order, of a dataset with these images and others in the split test."""
    splits = splits or ["train"] * len(images)
    rows = [*zip(images, splits, strict=True), *((image, "test") for image in others)]
    blank = dict.fromkeys(schemas.schema("samples").names)
    samples = [
        blank
        | {"sample_id": f"d/{split}/{image.rpartition('.')[0]}", "dataset": "d", "split": split}
        | {"scene": ".", "image": f"{split}/{image}"}
        for image, split in rows
    ]
    columns = {name: [s[name] for s in samples[: len(images)]] for name in blank}
    table = schemas.from_columns("samples", columns)
    catalogue = [(s["sample_id"], s["image"]) for s in samples]
    step = options.call(write.build, style=f"import:{path}", catalogue=lambda: catalogue)
    made = step(table).to_pylist()
    names = {s["sample_id"]: s["image"].partition("/")[2] for s in samples}
    return [(names[row["sample_id"]], row["text"]) for row in made]


COCO = {
    "images": [
        {"id": 7, "file_name": "COCO_val2014_000000000042.jpg", "width": 9, "height": 9},
        {"id": 8, "file_name": "1000268201_693b08cb0e.jpg"},
    ],
    "annotations": [
        {"id": 1, "image_id": 8, "caption": "A room."},
        {"id": 2, "image_id": 7, "caption": "A hall."},
    ],
    "licenses": [],
}
KARPATHY = {
    "images": [
        {
            "filepath": "rooms",
            "filename": "1000268201_693b08cb0e.jpg",
            "split": "train",
            "sentences": [{"tokens": ["a", "room"], "raw": "A room."}],
        },
        {"filename": "000000000042.jpg", "sentences": [{"tokens": ["a"], "raw": "A hall."}]},
    ],
    "dataset": "flickr8k",
}
LAVIS = [
    {"image": "rooms/1000268201_693b08cb0e.jpg", "caption": ["A room."], "image_id": "x_1"},
    {"image": "/home/x/data/train/rooms/000000000042.jpg", "caption": "A hall.", "image_id": "x_2"},
]
BOTH = [(A, "A room."), (B, "A hall.")]
RIGHT = {
    "Karpathy": ("d.json", json.dumps(KARPATHY)),
    "LAVIS": ("l.json", json.dumps(LAVIS)),
    "ViLBERT, a zip's members": (
        "v.jsonl",
        '{"image": "val_image.zip@/1000268201_693b08cb0e.jpg", "caption": "A room."}\n'
        '{"image": "val_image.zip@/000000000042.jpg", "caption": "A hall."}\n',
    ),
    "Hugging Face metadata.jsonl": (
        "metadata.jsonl",
        '{"file_name": "train/rooms/1000268201_693b08cb0e.jpg", "text": "A room."}\n\n'
        '{"file_name": "train/rooms/000000000042.jpg", "text": "A hall."}',
    ),
    "Hugging Face metadata.csv": (
        "metadata.csv",
        "file_name,text\r\n1000268201_693b08cb0e.jpg,A room.\r\n000000000042.jpg,A hall.\r\n",
    ),
    "Flickr8k captions.txt": (
        "captions.txt",
        "image,caption\n1000268201_693b08cb0e.jpg,A room.\n000000000042.jpg,A hall.\n",
    ),
    "Flickr8k.token.txt": (
        "Flickr8k.token.txt",
        "1000268201_693b08cb0e.jpg#0\tA room.\n000000000042.jpg#0\tA hall.\n",
    ),
    "Flickr30k results.csv": (
        "results.csv",
        "image_name| comment_number| comment\n1000268201_693b08cb0e.jpg| 0| A room.\n"
        "000000000042.jpg| 0| A hall.\n",
    ),
    "Excel in German": (
        "e.csv",
        "\ufeffImage;Caption\r\n1000268201_693b08cb0e.jpg;A room.\r\n000000000042.jpg;A hall.\r\n",
    ),
    "kohya meta_cap.json": (
        "meta_cap.json",
        json.dumps(
            {"C:\\x\\train\\rooms\\1000268201_693b08cb0e.jpg": {"caption": "A room."}}
            | {"000000000042": {"caption": "A hall.", "tags": "hall, door"}}
        ),
    ),
    "COCO results, ids alone": (
        "r.json",
        '[{"image_id": 42, "caption": "A hall."}, '
        '{"image_id": "1000268201_693b08cb0e", "caption": "A room."}]',
    ),
    "img2dataset, its keys": (
        "k.csv",
        "url,key,caption\nhttp://x/a,1000268201_693b08cb0e,A room.\n"
        "http://x/b,000000000042,A hall.\n",
    ),
}


@pytest.mark.parametrize(("name", "content"), RIGHT.values(), ids=RIGHT)
def test_forms_of_others(tmp_path, name, content):
    (tmp_path / name).write_text(content, newline="")
    assert imported(tmp_path / name) == BOTH


def test_coco_captions_go_by_their_list_of_images(tmp_path):
    (tmp_path / "c.json").write_text(json.dumps(COCO))
    images = ("1000268201_693b08cb0e.jpg", "COCO_val2014_000000000042.jpg")
    # 8 is the number of the file's own entry, not of an image called 8.
    assert imported(tmp_path / "c.json", images, others=("8.jpg",)) == [
        (images[0], "A room."),
        (images[1], "A hall."),
    ]


def test_a_caption_file_beside_each_image(tmp_path):
    (tmp_path / "rooms").mkdir()
    (tmp_path / "rooms/1000268201_693b08cb0e.caption").write_text("A room.\n")
    (tmp_path / "rooms/000000000042.txt").write_text("A hall.\n")
    assert imported(tmp_path) == BOTH


def test_quotation_marks_that_do_not_close_between_tabs(tmp_path):
    rows = 'image\tcaption\n1000268201_693b08cb0e.jpg\t"Stop it\n000000000042.jpg\t5" of it\n'
    (tmp_path / "q.tsv").write_text(rows)
    assert imported(tmp_path / "q.tsv") == [(A, '"Stop it'), (B, '5" of it')]


def test_a_missing_text_of_pandas_is_none(tmp_path):
    (tmp_path / "n.csv").write_text("image,caption\n000000000042.jpg,nan\n" + f"{A},A room.\n")
    assert imported(tmp_path / "n.csv") == [(A, "A room."), (B, "An image.")]


def test_labels_of_a_detector_are_no_texts(tmp_path):
    (tmp_path / "rooms").mkdir()
    (tmp_path / "rooms/000000000042.txt").write_text("0 0.5 0.5 0.2 0.3\n1 0.1 0.1 0.2 2e-1\n")
    with pytest.raises(RsaDataError, match="found only numbers, '0 0"):
        imported(tmp_path)


def test_five_texts_of_an_image_are_its_variants(tmp_path):
    lines = "".join(f"000000000042.jpg#{k}\tHall {k}, and more.\n" for k in range(5))
    (tmp_path / "f.token").write_text(lines)
    assert imported(tmp_path / "f.token", (B,)) == [(B, f"Hall {k}, and more.") for k in range(5)]


REFUSED = {
    "commas without quotation marks": (
        "c.txt",
        "image,caption\n000000000042.jpg,A hall, a door.\n",
        "c.txt line 2: expected 2 columns between ',', found 3",
    ),
    "a bar that is missing, as in Flickr30k": (
        "r.csv",
        "image_name| comment_number| comment\n000000000042.jpg| 4   A dog runs .\n",
        "line 2: expected 3 columns between '|', found 2",
    ),
    "the end of the download is missing": (
        "k.json",
        '[{"image": "000000000042.jpg", "caption": "A hall."}, {"image": "1',
        "k.json cannot be read",
    ),
    "texts cut into words": (
        "v.jsonl",
        '{"image": "000000000042.jpg", "caption": ["a", "hall", "with", "a", "door"]}',
        "lists of single words",
    ),
    "conversations": (
        "l.json",
        '[{"id": "a", "image": "000000000042.jpg", "conversations": [{"from": "gpt"}]}]',
        "one for its text .*; found id, image, conversations",
    ),
    "two columns of texts": (
        "m.csv",
        "file_name,text,prompt\n000000000042.jpg,A hall.,Describe it.\n",
        "found text, prompt: which is meant cannot be told",
    ),
    "no header": (
        "g.tsv",
        "a hall with a door\thttp://x/1.jpg\n",
        "expected a header with a column for the image",
    ),
    "annotations of other images": (
        "c.json",
        json.dumps(COCO | {"annotations": [{"image_id": 42, "caption": "A hall."}]}),
        "expected an image_id of its images; found 42",
    ),
    "UTF-16 of a spreadsheet": ("u.csv", "image,caption\na,b\n".encode("utf-16"), "UTF-16 text"),
    "Latin-1": ("u.csv", "image,caption\na,caf\u00e9\n".encode("latin-1"), "not UTF-8"),
    "instances instead of captions": (
        "i.json",
        json.dumps(COCO | {"annotations": [{"image_id": 7, "category_id": 1, "bbox": [0] * 4}]}),
        "one for its text",
    ),
    "another dataset's texts": ("o.json", '{"9.jpg": "A hall."}', "found none"),
}


@pytest.mark.parametrize(("name", "content", "says"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_read_is_refused(tmp_path, name, content, says):
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(RsaDataError, match=says.replace("|", r"\|")):
        imported(tmp_path / name)


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_no_text_is_given_to_two_images_of_any_split(tmp_path, kind):
    if kind == "folder":
        (tmp_path / "1.txt").write_text("A hall.\n")
        place = tmp_path
    else:
        place = tmp_path / "t.json"
        place.write_text('{"1.jpg": "A hall."}')
    assert imported(place, ("a/1.jpg",)) == [("a/1.jpg", "A hall.")]
    with pytest.raises(RsaDataError, match=r"found 2 of 2 images .*: d/test/a/1, d/train/a/1"):
        imported(place, ("a/1.jpg",), others=("a/1.jpg",))
    with pytest.raises(RsaDataError, match=r"found 2 of 3 images .*: d/test/b/1, d/train/a/1"):
        imported(place, ("a/1.jpg",), others=("b/1.jpg", "b/2.jpg"))


def test_longer_keys_tell_two_splits_apart(tmp_path):
    (tmp_path / "t.json").write_text('{"d/train/a/1": "A hall.", "test/a/1.jpg": "A bed."}')
    images = ("a/1.jpg", "a/1.jpg")
    found = imported(tmp_path / "t.json", images, splits=("train", "test"))
    assert [text for _, text in found] == ["A hall.", "A bed."]


def test_keys_of_no_image_are_counted(tmp_path):
    (tmp_path / "t.json").write_text('{"1.jpg": "A hall.", "2.jpg": "x", "3.jpg": "y"}')
    lines = write.STAGE.notes.write(
        [], style=f"import:{tmp_path / 't.json'}", catalogue=lambda: [("d/train/1", "1.jpg")]
    )
    assert lines == ["2 of 3 keys of t.json belong to no image of the dataset and are left out."]
