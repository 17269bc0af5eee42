"""Depth files of others: units, codes for "nothing", kinds that are no depth, turned photos.

benchmarks/foreign.md says where each comes from.
"""

import io

import cv2
import numpy as np
import pytest
from own_models import write_graph
from PIL import Image

from rsa_data.common.errors import RowError, RsaDataError
from rsa_data.datasets.folder import folder
from rsa_data.depth.measure import STAGE, build
from rsa_data.store import schemas

STEPS = np.array([[0, 512, 1024, 65535]], np.uint16)


def npy(values, **options):
    buffer = io.BytesIO()
    np.save(buffer, values, **options)
    return buffer.getvalue()


def png(values):
    return cv2.imencode(".png", values)[1].tobytes()


METRES = {
    "mm times 256": ("d.png", "m/256000", png(STEPS), [0, 0.002, 0.004, 0]),
    "a quarter of a millimetre": ("d.png", "m/4000", png(STEPS), [0, 0.128, 0.256, 0]),
    "centimetres, sky 65535": ("d.png", "cm", png(STEPS), [0, 5.12, 10.24, 0]),
    "an SR300's eighth of a mm": ("d.png", "m/8000", png(STEPS), [0, 0.064, 0.128, 0]),
    "NaN for the background": ("d.npy", "m", npy(np.array([[np.nan, 2.5]])), [0, 2.5]),
    "inf for the sky": ("d.npy", "m", npy(np.array([[np.inf, 2.5]], np.float16)), [0, 2.5]),
    "-1 for none": ("d.npy", "m", npy(np.array([[-1, 2.5]])), [0, 2.5]),
    "DIODE's (h, w, 1)": ("d.npy", "m", npy(np.full((2, 3, 1), 2.5, "<f4")), [[2.5] * 3] * 2),
    "big-endian": ("d.npy", "mm", npy(STEPS.astype(">u2")), [0, 0.512, 1.024, 0]),
    "Fortran order": ("d.npy", "mm", npy(np.asfortranarray(STEPS)), [0, 0.512, 1.024, 0]),
}


@pytest.mark.parametrize(("name", "unit", "data", "wanted"), METRES.values(), ids=METRES)
def test_units_and_codes(tmp_path, name, unit, data, wanted):
    (tmp_path / name).write_bytes(data)
    depth = folder(depth="depth", depth_unit=unit).read_depth(tmp_path / name)
    np.testing.assert_allclose(depth, np.atleast_2d(wanted), rtol=1e-3)


NONE = {
    "8 bits to be looked at": ("d.png", png(np.ones((2, 3), np.uint8)), "8 bits, grey"),
    "colours to be looked at": ("d.png", png(np.ones((2, 3, 3), np.uint8)), "8 bits, RGB"),
    "16 bits of three channels": ("d.png", png(np.ones((2, 3, 3), np.uint16)), "16 bits, RGB"),
    "a JPEG under that name": (
        "d.png",
        cv2.imencode(".jpg", np.ones((8, 8), np.uint8))[1].tobytes(),
        "expected a 16-bit grey PNG",
    ),
    "floats without a header": ("d.npy", np.ones(6, "<f4").tobytes(), "unreadable .npy"),
    "an EXR under that name": ("d.npy", b"\x76\x2f\x31\x01" + bytes(40), "unreadable .npy"),
    "a pickled object": ("d.npy", npy(np.array([{"depth": 1}]), allow_pickle=True), "unreadable"),
    "a stack of frames": ("d.npy", npy(np.ones((2, 3, 4))), "of shape (2, 3, 4)"),
    "complex": ("d.npy", npy(np.ones((2, 3), complex)), "complex128"),
    "a mask": ("d.npy", npy(np.ones((2, 3), bool)), "bool"),
    "nothing": ("d.npy", b"", "unreadable .npy"),
}


@pytest.mark.parametrize(("name", "data", "says"), NONE.values(), ids=NONE)
def test_what_is_no_depth_fails_the_row(tmp_path, name, data, says):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(RowError) as caught:
        folder(depth="depth", depth_unit="mm").read_depth(tmp_path / name)
    assert says in str(caught.value)


@pytest.mark.parametrize("name", ["a_depth.npy", "a.exr", "a.pfm", "a.npz", "a.tiff", "a.hdf5"])
def test_names_and_kinds_that_are_not_found_are_named(tmp_path, name):
    (tmp_path / "rgb").mkdir()
    (tmp_path / "depth").mkdir()
    Image.new("RGB", (4, 3)).save(tmp_path / "rgb/a.png")
    (tmp_path / "depth" / name).write_bytes(b"x")
    with pytest.raises(RsaDataError, match=r"expected depth such as depth/a.png"):
        folder(images="rgb", depth="depth", depth_unit="m").index(tmp_path, None)


def samples(split="train"):
    blank = dict.fromkeys(schemas.schema("samples").names)
    row = blank | {"sample_id": f"d/{split}/a", "dataset": "d", "split": split, "scene": "."}
    row |= {"image": "a.jpg", "depth": "a.png"}
    return schemas.from_columns("samples", {name: [row[name]] for name in blank})


CARD = 'kind = "relative-depth"\nresize = "squash"\nwidth = 4\nheight = 3\noutput = "inverse"\n'

TURNS = {
    "upright": (1, (6, 8), None),
    "upside down": (3, (6, 8), "EXIF orientation 3"),
    "mirrored": (2, (6, 8), "EXIF orientation 2"),
    "on its side, depth as displayed": (6, (8, 6), None),
    "on its side, depth as the sensor lay": (6, (6, 8), "which is transposed"),
    "a square on its side": (8, (7, 7), "EXIF orientation 8"),
}


@pytest.mark.parametrize(("turn", "shape", "says"), TURNS.values(), ids=TURNS)
def test_depth_of_photos_that_exif_turns(tmp_path, turn, shape, says):
    exif = Image.Exif()
    exif[0x0112] = turn
    stored = (7, 7) if shape == (7, 7) else (8, 6)
    grey = np.random.default_rng(0).integers(0, 255, stored[::-1], dtype=np.uint8)
    Image.fromarray(grey).save(tmp_path / "a.jpg", exif=exif)
    depth = np.random.default_rng(1).integers(1000, 3000, shape).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "a.png"), depth)
    (tmp_path / "c.toml").write_text(CARD)
    write_graph(
        tmp_path / "m.onnx",
        [("ReduceMean", ["x"], ["y"], {"axes": [1], "keepdims": 1})],
        [("x", [1, 3, 3, 4])],
        [("y", [1, 1, 3, 4])],
    )
    dataset = folder(depth="depth", depth_unit="mm")
    weights = {"card": tmp_path / "c.toml", "depth_weights": tmp_path / "m.onnx"}
    (row,) = build(dataset=dataset, root=tmp_path, **weights)(samples()).to_pylist()
    assert row["error"] is None if says is None else says in row["error"]


def test_much_depth_outside_the_stated_range_is_said(tmp_path):
    depth = np.full((6, 8), 2500, np.uint16)
    depth[:2] = 30_000
    cv2.imwrite(str(tmp_path / "a.png"), depth)
    np.save(tmp_path / "y.npy", 1 / np.random.default_rng(0).uniform(1, 5, (6, 8)))
    (tmp_path / "a.npy").write_bytes((tmp_path / "y.npy").read_bytes())
    dataset = folder(depth="depth", depth_unit="mm", max_depth=10.0)
    (tmp_path / "y").mkdir()
    (tmp_path / "a.npy").rename(tmp_path / "y/a.npy")
    options = {"depth_model": f"files:{tmp_path}/y"}
    made = build(dataset=dataset, root=tmp_path, **options)(samples())
    where = {"dataset": dataset, "root": tmp_path}
    lines = STAGE.notes.write([made.select(STAGE.notes.columns)], samples(), **options, **where)
    assert lines[1].startswith("warning: 33% of the ground truth lies beyond 10 m")
    assert "largest value: 30 m" in lines[1]
    depth[:2] = 2600
    cv2.imwrite(str(tmp_path / "a.png"), depth)
    lines = STAGE.notes.write([made.select(STAGE.notes.columns)], samples(), **options, **where)
    assert not [line for line in lines if "beyond" in line]
