"""Readers of ground-truth depth, against OpenCV, NumPy and the real files beside a checkout."""

import io

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rsa_data.common.errors import RowError
from rsa_data.datasets.depth_files import npy, png16, units_per_metre
from rsa_data.datasets.folder import folder
from rsa_data.datasets.kitti import kitti
from rsa_data.datasets.nyuv2 import nyuv2

VALUES = np.array([[0, 1, 1500], [65535, 256, 10_000]], np.uint16)


def png(values) -> bytes:
    return cv2.imencode(".png", values)[1].tobytes()


def npy_bytes(values, **options) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, values, **options)
    return buffer.getvalue()


def put(folder_, name, data: bytes):
    (folder_ / name).write_bytes(data)
    return folder_ / name


@pytest.mark.parametrize(
    ("unit", "per_metre"), [("m", 1), ("cm", 100), ("mm", 1000), ("m/256", 256), ("m/5000", 5000)]
)
def test_units(tmp_path, unit, per_metre):
    depth = png16(units_per_metre(unit))(put(tmp_path, "d.png", png(VALUES)))
    assert depth.dtype == np.float32
    np.testing.assert_array_equal(depth, VALUES.astype(np.float32) / np.float32(per_metre))


def test_values_that_mean_none(tmp_path):
    path = put(tmp_path, "d.png", png(VALUES))
    expected = np.array([[0, 0.001, 1.5], [0, 0.256, 10]], np.float32)
    np.testing.assert_array_equal(png16(1000, none=(0, 65535))(path), expected)
    own = folder(depth="depth", depth_unit="mm")
    np.testing.assert_array_equal(own.read_depth(path), expected)


def test_npy(tmp_path):
    values = np.array([[1.5, np.nan, np.inf], [-1, 0, 2]], ">f8")
    expected = np.array([[1.5, 0, 0], [0, 0, 2]], np.float32)
    np.testing.assert_array_equal(npy(1)(put(tmp_path, "d.npy", npy_bytes(values))), expected)
    path = put(tmp_path, "mm.npy", npy_bytes(np.asfortranarray(VALUES)))
    expected = np.where(VALUES < 65535, VALUES, 0).astype(np.float32) / np.float32(1000)
    np.testing.assert_array_equal(npy(1000)(path), expected)


@pytest.mark.parametrize("shape", [(2, 3, 1), (1, 2, 3), (1, 2, 3, 1)])
def test_axes_of_size_one_are_dropped(tmp_path, shape):
    values = np.arange(1.0, 7.0).reshape(shape)
    depth = npy(1)(put(tmp_path, "d.npy", npy_bytes(values)))
    np.testing.assert_array_equal(depth, values.reshape(2, 3).astype(np.float32))


def test_no_value_codes_of_integers(tmp_path):
    own = folder(depth="depth", depth_unit="mm")
    for kind, none in ((np.uint16, [65535]), (np.int32, [65535, -1, 2**31 - 1]), (np.int16, [-1])):
        values = np.array([[2000, *none, 0]], kind)
        depth = own.read_depth(put(tmp_path, "d.npy", npy_bytes(values)))
        np.testing.assert_array_equal(depth, [[2, *[0] * len(none), 0]])


def test_steps_a_metre_are_counted_in_integers(tmp_path):
    own = folder(depth="depth", depth_unit="m/256")
    assert own.read_depth(put(tmp_path, "d.npy", npy_bytes(np.array([[640]])))) == [[2.5]]
    with pytest.raises(RowError, match=r"found float64; if the file is in metres, say depth_unit"):
        own.read_depth(put(tmp_path, "d.npy", npy_bytes(np.array([[2.5]]))))


BROKEN_PNG = {
    "8 bits": (png(VALUES.astype(np.uint8)), "found 8 bits, grey"),
    "colour": (png(np.zeros((2, 2, 3), np.uint16)), "found 16 bits, RGB"),
    "a photograph": (b"\xff\xd8\xff\xe0", "expected a 16-bit grey PNG, found a file that begins"),
    "empty": (b"", "expected a 16-bit grey PNG, found an empty file"),
    "signature only": (png(VALUES)[:8], "found a PNG without a header"),
    "cut": (png(VALUES)[:-30], "unreadable PNG"),
    "bomb": (
        png(VALUES)[:16] + (1 << 20).to_bytes(4, "big") * 2 + png(VALUES)[24:],
        "expected at most 100000000 pixels, found 1048576 x 1048576",
    ),
}


@pytest.mark.parametrize(("data", "reason"), BROKEN_PNG.values(), ids=BROKEN_PNG)
def test_broken_png(tmp_path, data, reason):
    with pytest.raises(RowError) as caught:
        png16(1000)(put(tmp_path, "d.png", data))
    assert reason in str(caught.value) and str(tmp_path) not in str(caught.value)


BROKEN_NPY = {
    "three axes": (npy_bytes(np.zeros((4, 2, 3))), "found float64 of shape (4, 2, 3)"),
    "truth values": (npy_bytes(np.zeros((2, 2), bool)), "found bool of shape (2, 2)"),
    "pickle": (npy_bytes(np.array([[None]]), allow_pickle=True), "unreadable .npy"),
    "cut": (npy_bytes(np.zeros((4, 4)))[:-1], "unreadable .npy"),
    "a header with a name in it": (
        npy_bytes(VALUES).replace(b"False", b"Felse"),
        "malformed node or string on line 1: <ast.Name object>",
    ),
    "not an array": (b"hello", "unreadable .npy"),
}


@pytest.mark.parametrize(("data", "reason"), BROKEN_NPY.values(), ids=BROKEN_NPY)
def test_broken_npy(tmp_path, data, reason):
    with pytest.raises(RowError) as caught:
        npy(1)(put(tmp_path, "d.npy", data))
    assert reason in str(caught.value)


@pytest.mark.parametrize("read", [png16(1000), npy(1)], ids=["png", "npy"])
@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_damaged_files_are_depth_or_a_row_error(tmp_path, read, data):
    good = data.draw(st.sampled_from([png(VALUES), npy_bytes(VALUES)]))
    damaged = bytearray(good)
    damaged[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    try:
        depth = read(put(tmp_path, "d", bytes(damaged)))
    except RowError:
        return
    assert (depth.dtype, depth.ndim) == (np.float32, 2)


REAL = {
    "nyuv2": (nyuv2(), "nyuv2/sync_depth_00050.png", 1000, (480, 640), (1.0, 5.0)),
    "kitti": (kitti(), "kitti/0000000050_depth.png", 256, (375, 1242), (5.0, 30.0)),
}


@pytest.mark.parametrize(("dataset", "path", "divisor", "shape", "middle"), REAL.values(), ids=REAL)
def test_real_depth_is_in_metres(shared, dataset, path, divisor, shape, middle):
    depth = dataset.read_depth(shared / "rgbd" / path)
    values = cv2.imread(str(shared / "rgbd" / path), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(depth, values.astype(np.float32) / np.float32(divisor))
    assert depth.shape == shape
    assert middle[0] < np.median(depth[depth > 0]) < middle[1]
