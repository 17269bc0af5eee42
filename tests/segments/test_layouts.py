"""One detection written in every layout that the decoder families of detectors take."""

import numpy as np
import pytest

from rsa_data.common.class_names import ClassTable
from rsa_data.registry import DECODERS, resolve
from rsa_data.segments.preprocess import Geometry

TABLE = ClassTable({0: "a", 1: "b", 2: "c"}, frozenset({0, 1}), 3)
# An image of 60 x 30 px in the upper half of a letterbox of 40 x 40: 1.5 px of it a px of input.
GEOMETRY = Geometry(60, 30, 40, 20, 40, 40)
SMALL = Geometry(6, 4, 6, 4, 6, 4)  # image and input are the same 6 x 4 px
# Centre, width and height in px of the input; corners in px of the image.
CENTER = np.array([20.0, 10, 16, 8])
CORNERS = np.array([12.0, 6, 28, 14]) * 1.5


def decode(family, settings, outputs, geometry=GEOMETRY):
    decoder = resolve("decoder", DECODERS, family)({"score_threshold": 0.4} | settings, TABLE)
    for role, (axes, axis, size) in decoder.roles.items():
        assert outputs[role].ndim == axes and (not axis or outputs[role].shape[axis] == size)
    return decoder.decode(outputs, geometry)


@pytest.mark.parametrize("shares", [False, True])
@pytest.mark.parametrize("objectness", [False, True])
@pytest.mark.parametrize("columns_first", [False, True])
def test_yolo(shares, objectness, columns_first):
    center = CENTER / 40 if shares else CENTER
    scores = [0.1, 0.2, 0.9]
    row = [*center, 0.5, *scores] if objectness else [*center, *scores]
    below = [*center[:2] * 0.5, *center[2:], 0.5, 0.79, 0.1, 0.1] if objectness else [
        *center[:2] * 0.5, *center[2:], 0.4, 0.1, 0.1]  # fmt: skip
    rows = np.array([below, row, row], np.float32)  # the third is suppressed
    settings = {"objectness": objectness, "columns_first": columns_first}
    settings |= {"coordinates": "shares"} if shares else {}
    found = decode("yolo", settings, {"predictions": (rows.T if columns_first else rows)[None]})
    assert (found.number.tolist(), found.query.tolist(), found.candidates) == ([2], [1], 3)
    assert found.score.tolist() == pytest.approx([0.45 if objectness else 0.9])
    np.testing.assert_allclose(found.box, [CORNERS], rtol=1e-5)


def test_yolo_without_suppression_keeps_both():
    rows = np.array([[*CENTER, 0.1, 0.9, 0.1], [*CENTER, 0.1, 0.8, 0.1]], np.float32)
    rows[1, 0] += 1
    for overlap, kept in ((1.0, 2), (0.45, 1)):
        found = decode("yolo", {"overlap_threshold": overlap}, {"predictions": rows[None]})
        assert len(found.number) == kept


def test_masks_of_prototypes_are_cut_to_their_box():
    # The first plane is positive in the left half, the second in the lower one.
    planes = np.full((2, 4, 6), -9, np.float32)
    planes[0, :, :3] = planes[1, 2:] = 9
    box = [1.5, 0.6, 5.0, 4.0]  # of the pixels, those whose centre is inside: x 2 to 4, y 1 to 3
    center = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2, box[2] - box[0], box[3] - box[1]]
    inside = np.zeros((4, 6), bool)
    inside[1:4, 1:5] = True
    for terms, plane in (
        ((1, 0), planes[0] > 0),
        ((0, 1), planes[1] > 0),
        ((-1, 0), planes[0] < 0),
    ):
        row = np.array([[[*center, 0.9, 0.1, 0.1, *terms]]], np.float32)
        outputs = {"predictions": row, "prototypes": planes[None]}
        found = decode("yolo", {"prototypes": 2}, outputs, SMALL)
        np.testing.assert_array_equal(found.masks[0], plane & inside)
        columns = ["x1", "y1", "x2", "y2", "score", "class"]
        rows = np.array([[*box, 0.9, 1, *terms]], np.float32)
        outputs = {"rows": rows, "prototypes": planes[None]}
        settings = {"columns": columns, "prototypes": 2, "coordinates": "input"}
        found = decode("final-rows", settings, outputs, SMALL)
        np.testing.assert_array_equal(found.masks[0], plane & inside)


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize(
    ("coordinates", "unit"), [("image", 1.5), ("input", 1), ("shares", 1 / 40)]
)
def test_final_detections(coordinates, unit, axes):
    corners = CORNERS / 1.5 * unit
    boxes = np.array([corners, corners + unit, corners + 2 * unit, corners], np.float32)
    score, number = np.float32([0.5, 0.9, 0.4, 0.8]), np.float32([1, 2, 0, -1])
    settings = {"coordinates": coordinates, "axes": axes}
    columns = ["batch", "class", "score", "x1", "y1", "x2", "y2"]
    rows = np.concatenate([np.zeros((4, 1)), number[:, None], score[:, None], boxes], 1)
    if axes == 3:
        rows, boxes, score, number = rows[None], boxes[None], score[None], number[None]
    for family, outputs, more in (
        ("final-rows", {"rows": rows.astype(np.float32)}, {"columns": columns}),
        ("final-boxes", {"boxes": boxes, "scores": score, "classes": number}, {}),
    ):
        found = decode(family, settings | more, outputs)
        assert found.number.tolist() == [2, 1]
        assert found.score.tolist() == pytest.approx([0.9, 0.5])
        np.testing.assert_allclose(found.box, [CORNERS + 1.5, CORNERS], rtol=1e-5)


def test_instances_whose_masks_cover_the_input():
    each = np.zeros((2, 4, 6), np.float32)
    each[0, :2], each[1, :, 4:] = 0.49, 0.5
    outputs = {
        "boxes": np.array([[0, 0, 6, 2], [4, 0, 6, 4]], np.float32),
        "scores": np.float32([0.6, 0.9]),
        "classes": np.array([0, 1]),
        "masks": each,
    }
    settings = {"masks_show": "input", "mask_axes": 3}
    found = decode("instances", settings, outputs, SMALL)
    assert found.number.tolist() == [1, 0]
    np.testing.assert_array_equal(found.masks[0], each[1] >= 0.5)
    assert not found.masks[1].any()


def test_strides_of_nanodet():
    outputs = {}
    for stride, cells in ((8, 16), (16, 4), (32, 1)):  # of an input of 32 x 32 px
        outputs[f"classes_{stride}"] = np.zeros((1, cells, 3), np.float32)
        outputs[f"boxes_{stride}"] = np.full((1, cells, 4 * 8), -50, np.float32)
        outputs[f"boxes_{stride}"][0, :, 0::8] = 50  # all sides 0
    outputs["classes_32"][0, 0, 2] = 0.7
    outputs["boxes_32"][0, 0, [1, 8 + 1]] = 50 + np.log(3)  # 1 with 3/4: left and top
    found = decode("nanodet", {"overlap_threshold": 0.6}, outputs, Geometry(*[32] * 6))
    np.testing.assert_allclose(found.box, [[15.5 - 24, 15.5 - 24, 15.5, 15.5]], atol=1e-3)


@pytest.mark.parametrize(("moved", "kept"), [(6, 1), (9, 2)])
def test_yolo_suppresses_above_045_where_its_card_says_nothing(moved, kept):
    # Two boxes of 20 x 8 px, so many px apart: they share (20 - m) of 20 + m columns.
    row = [20.0, 10, 20, 8, 0.1, 0.9, 0.1]
    rows = np.array([row, [row[0] + moved, *row[1:5], 0.8, 0.1]], np.float32)
    found = decode("yolo", {}, {"predictions": rows[None]}, Geometry(80, 40, 80, 40, 80, 40))
    assert ((20 - moved) / (20 + moved) < 0.45) == (kept == 2)
    assert len(found.number) == kept
