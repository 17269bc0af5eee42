"""Importers fed with what hypothesis makes of real files: no error but the project's own."""

import contextlib
import copy
import json
import os
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from coco_files import PANOPTIC, RESULTS, SAMPLES
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from rsa_data.common import names_files
from rsa_data.common.errors import RowError, RsaDataError
from rsa_data.datasets import images
from rsa_data.datasets.depth_files import npy, png16
from rsa_data.datasets.folder import folder
from rsa_data.depth import files as depth_files
from rsa_data.runner import pipeline_files
from rsa_data.segments import coco_detections, coco_panoptic, maps, rsa_release

FEW = settings(
    max_examples=int(os.environ.get("RSA_DATA_FUZZ", "150")),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)

JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text()
    | st.sampled_from([2**63, -1, 10**400, "../../../etc/passwd", "/etc/passwd", "a\0b", "nan"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=5,
)


def places(value: Any, where: tuple = ()) -> list[tuple]:
    """The path of every value inside a JSON value."""
    if not isinstance(value, (dict, list)):
        return [where]
    inner = value.items() if isinstance(value, dict) else enumerate(value)
    return [where, *(p for key, v in inner for p in places(v, (*where, key)))]


@st.composite
def mutated(draw: Any, base: Any) -> Any:
    """A copy of a JSON value with one to three places replaced or taken out."""
    changed = copy.deepcopy(base)
    for _ in range(draw(st.integers(1, 3))):
        where = draw(st.sampled_from(places(changed)))
        if not where:
            return draw(JSON)
        parent = changed
        for key in where[:-1]:
            parent = parent[key]
        if draw(st.booleans()):
            parent[where[-1]] = draw(JSON)
        else:
            del parent[where[-1]]
    return changed


@st.composite
def damaged(draw: Any, data: bytes) -> bytes:
    """A copy of a file with some bytes changed, cut out or put in."""
    changed = bytearray(data)
    for _ in range(draw(st.integers(1, 6))):
        at = draw(st.integers(0, max(0, len(changed) - 1)))
        kind = draw(st.sampled_from(("change", "cut", "insert", "end")))
        if kind == "change" and changed:
            changed[at] = draw(st.integers(0, 255))
        elif kind == "cut":
            del changed[at : at + draw(st.integers(1, 50))]
        elif kind == "insert":
            changed[at:at] = draw(st.binary(max_size=20))
        else:
            del changed[at:]
    return bytes(changed)


def picture(kind: str, mode: str = "RGB") -> bytes:
    buffer = BytesIO()
    values = np.arange(12 * 9 * 3, dtype=np.uint8).reshape(9, 12, 3)
    if mode == "I;16":
        Image.fromarray(values[..., 0].astype(np.uint16) * 9).save(buffer, kind)
    else:
        Image.fromarray(values).convert(mode).save(buffer, kind)
    return buffer.getvalue()


def accounted(step: Any) -> None:
    """One sample in, one row out, ok or failed with a reason."""
    rows = step(SAMPLES).to_pylist()
    assert [row["sample_id"] for row in rows] == ["rooms/train/a"]
    assert (rows[0]["status"] == "ok") != bool(rows[0]["error"])


@FEW
@given(content=mutated(PANOPTIC))
def test_coco_panoptic(tmp_path, content):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(content))
    ids = np.zeros((3, 4, 3), np.uint8)
    ids[..., 0] = 7
    Image.fromarray(ids).save(tmp_path / "a.png")
    with contextlib.suppress(RsaDataError):
        accounted(coco_panoptic.build(argument=str(path), dataset=folder(), root=None))


@pytest.mark.parametrize("name", ["../a.png", "b/../../a.png"])
def test_coco_panoptic_cannot_name_files_elsewhere(tmp_path, name):
    content = copy.deepcopy(PANOPTIC)
    content["annotations"][0]["file_name"] = name
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(RsaDataError, match="expected a path below"):
        coco_panoptic.build(argument=str(tmp_path / "a.json"), dataset=folder(), root=None)


@FEW
@given(content=mutated(RESULTS))
def test_coco_detections(tmp_path, content):
    pytest.importorskip("pycocotools")
    path = tmp_path / "a.json"
    path.write_text(json.dumps(content))
    with contextlib.suppress(RsaDataError):
        accounted(coco_detections.build(argument=str(path), dataset=folder(), root=None))


@FEW
@given(text=st.lists(st.text() | st.sampled_from(["bed 0.5", "a b nan", "x 1e999"])))
def test_released_text(text):
    try:
        found = rsa_release.parse(text)
    except RowError:
        return
    assert ((found.area >= 0) & (found.area <= 1)).all()
    assert all(label and len(label) <= 200 for label in found.label)


@FEW
@given(data=damaged(picture("PNG", "I;16")))
def test_depth_png(tmp_path, data):
    (tmp_path / "a.png").write_bytes(data)
    for read in (png16(1000.0), lambda p: depth_files.read(p.parent, "a").y):
        try:
            assert read(tmp_path / "a.png").ndim == 2
        except RowError as error:
            assert str(tmp_path) not in str(error)


def array() -> bytes:
    buffer = BytesIO()
    np.save(buffer, np.ones((3, 4), np.float32))
    return buffer.getvalue()


@FEW
@given(data=damaged(array()))
def test_depth_npy(tmp_path, data):
    (tmp_path / "a.npy").write_bytes(data)
    for read in (npy(1.0), lambda p: depth_files.read(p.parent, "a").y):
        try:
            assert read(tmp_path / "a.npy").ndim == 2
        except RowError as error:
            assert str(tmp_path) not in str(error)


def test_a_signalling_nan_is_no_depth(tmp_path):
    values = np.ones((3, 4), np.float32)
    values.view(np.uint32)[0, 1] = 0x7F810000
    np.save(tmp_path / "a.npy", values)
    assert npy(1.0)(tmp_path / "a.npy")[0].tolist() == [1, 0, 1, 1]


@FEW
@given(
    data=st.sampled_from(
        [picture(k) for k in ("JPEG", "PNG", "GIF", "BMP", "TIFF", "WEBP")]
    ).flatmap(damaged)
)
@pytest.mark.filterwarnings("ignore")  # Pillow's, of damaged metadata
def test_image(tmp_path, data):
    (tmp_path / "a").write_bytes(data)
    for read in (images.read_image, maps.read_numbers, maps.read_colour_ids):
        try:
            assert read(tmp_path / "a").ndim in (2, 3)
        except RowError as error:
            assert str(tmp_path) not in str(error)


@FEW
@given(data=damaged(b'[dataset.nyuv2]\nroot = "a"\n[captions]\nvariants = 2\n') | st.binary())
def test_job_file(tmp_path, data):
    (tmp_path / "job.toml").write_bytes(data)
    with contextlib.suppress(RsaDataError):
        pipeline_files.load(tmp_path / "job.toml")


@FEW
@given(data=damaged(b'names = ["bed", "chair"]\nthings = ["bed"]\n') | st.binary())
@pytest.mark.parametrize("suffix", [".toml", ".txt"])
def test_class_table(tmp_path, data, suffix):
    path = Path(tmp_path / f"names{suffix}")
    path.write_bytes(data)
    with contextlib.suppress(RsaDataError):
        names_files.read(path)
