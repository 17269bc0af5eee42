"""The released RSA text: names kept whole, bad lines quarantined, every file found."""

import tarfile
import time

import numpy as np
import pyarrow.compute as pc
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsa_data.common.errors import RowError, RsaDataError
from rsa_data.datasets.dataset import Dataset
from rsa_data.segments import rsa_release
from rsa_data.store import schemas


def dataset(name):
    return Dataset(
        name,
        index=lambda root, split: None,
        read_depth=lambda path: None,
        min_depth=1e-3,
        max_depth=10,
        key_paths=lambda split, key: (f"{split}/{key}.jpg", None),
        scene=lambda key: key.split("/")[0],
    )


def write(folder, files):
    for name, text in files.items():
        path = folder / "text" / "seg_txt_panoptic" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode() if isinstance(text, str) else text)
    return str(folder)


def test_index_and_segments(tmp_path):
    where = write(
        tmp_path,
        {
            "nyu/test/kitchen/rgb_00002.txt": "traffic light 0.25\nwall 0.5\n\n",
            "nyu/test/bath/rgb_00001.5.txt": "",
            "nyu/train/den_0001/rgb_00000.txt": "chair 1\r\n",
            "kitti/test/a.txt": "car 1.0",
        },
    )
    samples = rsa_release.index_release(where, dataset("nyuv2"))
    schemas.check("samples", samples)
    assert samples.select(["sample_id", "split", "scene", "image"]).to_pylist() == [
        {
            "sample_id": f"nyuv2/{split}/{scene}/{name}",
            "split": split,
            "scene": scene,
            "image": f"{split}/{scene}/{name}.jpg",
        }
        for split, scene, name in [
            ("test", "bath", "rgb_00001.5"),
            ("test", "kitchen", "rgb_00002"),
            ("train", "den_0001", "rgb_00000"),
        ]
    ]
    found = rsa_release.build(argument=where, dataset=dataset("nyuv2"))(samples)
    schemas.check("segments", found)
    columns = ["status", "label", "area", "score", "box", "is_thing"]
    assert found.select(columns).to_pylist() == [
        {"status": "ok", "label": [], "area": [], "score": [], "box": None, "is_thing": []},
        {
            "status": "ok",
            "label": ["traffic light", "wall"],
            "area": [0.25, 0.5],
            "score": [1.0, 1.0],
            "box": None,
            "is_thing": [True, False],
        },
        {
            "status": "ok",
            "label": ["chair"],
            "area": [1.0],
            "score": [1.0],
            "box": None,
            "is_thing": [True],
        },
    ]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("bed 0.1\n\nbed nan", "line 3: area must be a number in [0, 1], found 'nan'"),
        ("bed 1.5", "line 1: area must be a number in [0, 1], found '1.5'"),
        ("bed -0.1", "line 1: area must be a number in [0, 1], found '-0.1'"),
        ("bed inf", "line 1: area must be a number in [0, 1], found 'inf'"),
        ("wine glass", "line 1: area must be a number in [0, 1], found 'glass'"),
        ("bed", "line 1: expected CLASS SHARE, found 'bed'"),
        ("0.5", "line 1: expected CLASS SHARE, found '0.5'"),
    ],
)
def test_bad_line_quarantines_the_row(tmp_path, text, reason):
    where = write(tmp_path, {"nyu/test/x.txt": text, "nyu/test/y.txt": "bed 0.5"})
    step = rsa_release.build(argument=where, dataset=dataset("nyuv2"))
    found = step(rsa_release.index_release(where, dataset("nyuv2")))
    assert found["status"].to_pylist() == ["failed", "ok"]
    assert found["error"].to_pylist() == [f"segments/rsa-release: nyu/test/x.txt {reason}", None]


def test_missing_and_undecodable_files_quarantine_the_row(tmp_path):
    where = write(tmp_path, {"nyu/test/x.txt": b"\xff 0.5", "nyu/test/y.txt": "bed 0.5"})
    samples = rsa_release.index_release(where, dataset("nyuv2"))
    (tmp_path / "text/seg_txt_panoptic/nyu/test/y.txt").unlink()
    found = rsa_release.build(argument=where, dataset=dataset("nyuv2"))(samples)
    assert found["error"].to_pylist() == [
        "segments/rsa-release: nyu/test/x.txt: expected UTF-8 text; found byte 0xff at offset 0, "
        "which is not UTF-8",
        "segments/rsa-release: nyu/test/y.txt: expected this file; found none",
    ]


def test_wrong_folder_split_or_dataset(tmp_path):
    where = write(tmp_path, {"nyu/test/x.txt": "bed 0.5"})
    with pytest.raises(RsaDataError, match="expected a folder seg_txt_panoptic/kitti"):
        rsa_release.build(argument=where, dataset=dataset("kitti"))
    with pytest.raises(RsaDataError, match=r"expected a split among test in .*; found 'val'"):
        rsa_release.index_release(where, dataset("nyuv2"), "val")
    with pytest.raises(RsaDataError, match="Write rsa-release:DIR"):
        rsa_release.build(argument=None, dataset=dataset("nyuv2"))


@given(st.lists(st.tuples(st.from_regex(r"\A[a-z]+( [a-z]+){0,3}\Z"), st.floats(0, 1))))
def test_lines_written_as_the_release_does_come_back(rows):
    found = rsa_release.parse([f"{name} {share}" for name, share in rows])
    assert list(zip(found.label, found.area, strict=True)) == rows


@given(st.text())
def test_any_text_parses_or_is_refused(text):
    try:
        found = rsa_release.parse(text.split("\n"))
    except RowError:
        return
    assert all(found.label)
    assert np.all((found.area >= 0) & (found.area <= 1))


@pytest.mark.parametrize(
    ("name", "archives", "samples", "segments", "matching", "words"),
    [
        ("nyuv2", ["nyu-train", "nyu-test"], 24885, 345104, 19247, " "),
        ("kitti", ["kitti-test"], 652, 9225, 326, "traffic light"),
    ],
)
def test_the_whole_release(shared, tmp_path, name, archives, samples, segments, matching, words):
    for archive in archives:
        with tarfile.open(shared / "rsa_release" / f"{archive}.tar.xz") as tar:
            members = [m for m in tar if "seg_txt_panoptic" in m.name]
            tar.extractall(tmp_path, members, filter="data")
    start = time.process_time()
    folder = next(tmp_path.rglob("seg_txt_panoptic")).parent
    index = rsa_release.index_release(str(folder), dataset(name))
    found = rsa_release.build(argument=str(folder), dataset=dataset(name))(index)
    seconds = time.process_time() - start  # what else runs here does not count
    labels = pc.list_flatten(found["label"])
    assert pc.unique(found["status"]).to_pylist() == ["ok"]
    assert (len(found), len(labels)) == (samples, segments)
    assert pc.sum(pc.match_substring(labels, words)).as_py() == matching
    assert seconds < 12, f"reading {samples} files took {seconds:.1f} s"
