"""Detectors that others exported, recognised and decoded: graphs of their forms, made here.

Each graph answers constants. The oracle decodes them with loops over plain numbers, by the form's
own description, and letterboxes as its programs do.
"""

import numpy as np
import onnx
import pyarrow as pa
import pytest
from onnx import TensorProto, helper, numpy_helper
from PIL import Image

from rsa_data.common.errors import RsaDataError
from rsa_data.datasets.dataset import Dataset
from rsa_data.segments import detect
from rsa_data.store import schemas

DATASET = Dataset("folder", lambda root, split: None, lambda path: None, 1e-3, 10)
WIDTH, HEIGHT, SIDE = 200, 100, 64
ANCHORS = 64 + 16 + 4  # cells of strides 8, 16 and 32
NAMES = {"names": "{0: 'cat', 1: 'T-shirt', 2: 'dog'}", "imgsz": "[64, 64]", "stride": "32"}
TASK = NAMES | {"task": "detect"}


def write(path, outputs, meta, inputs=(("images", (1, 3, SIDE, SIDE), TensorProto.FLOAT),)):
    """A graph that takes pictures and answers constants: name -> array."""
    nodes, constants, answers = [], [], []
    first = inputs[0][0]
    nodes.append(helper.make_node("ReduceMax", [first], ["most"], keepdims=0))
    nodes.append(helper.make_node("Sub", ["most", "most"], ["zero"]))
    for name, array in outputs.items():
        array = np.asarray(array)
        constants.append(numpy_helper.from_array(array, f"{name}_c"))
        if array.dtype == np.float32:
            nodes.append(helper.make_node("Add", [f"{name}_c", "zero"], [name]))
        else:
            nodes.append(helper.make_node("Identity", [f"{name}_c"], [name]))
        kind = helper.np_dtype_to_tensor_dtype(array.dtype)
        answers.append(helper.make_tensor_value_info(name, kind, array.shape))
    taken = [helper.make_tensor_value_info(name, kind, shape) for name, shape, kind in inputs]
    graph = helper.make_graph(nodes, "g", taken, answers, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    helper.set_model_props(model, meta)
    onnx.save(model, path)
    return path


def run(folder, weights, **options):
    image = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    Image.fromarray(image).save(folder / "a.png")
    samples = pa.table({"sample_id": ["a"], "image": ["a.png"]})
    step = detect.build(
        dataset=DATASET, root=folder, segments="onnx", segmenter_weights=weights, **options
    )
    found = step(samples)
    schemas.check("segments", found)
    return found.to_pylist()[0]


def told(weights):
    table = pa.table({"status": ["ok"], "label": [["cat"]], "score": [[0.9]]})
    return detect.STAGE.notes.write([table], segments="onnx", segmenter_weights=weights)[0]


def centred(x1, y1, x2, y2):
    """Ultralytics' way back: 64 x 32 px of the input show the image, 16 px stand above it."""
    return [x1 / 0.32, (y1 - 16) / 0.32, x2 / 0.32, (y2 - 16) / 0.32]


def clipped(box):
    x1, y1, x2, y2 = box
    return [max(x1, 0), max(y1, 0), min(x2, WIDTH), min(y2, HEIGHT)]


def share(box):
    x1, y1, x2, y2 = clipped(box)
    return (x2 - x1) * (y2 - y1) / (WIDTH * HEIGHT)


def check(row, expected):
    """expected : (label, score, box in px of the image), best first."""
    assert row["error"] is None
    assert row["label"] == [label for label, _, _ in expected]
    assert row["score"] == pytest.approx([score for _, score, _ in expected], abs=1e-6)
    np.testing.assert_allclose(row["box"], [clipped(box) for _, _, box in expected], atol=1e-3)
    assert row["area"] == pytest.approx([share(box) for _, _, box in expected], abs=1e-6)


# Two objects, one of them seen twice (suppressed), and one below the threshold; corners, px.
SEEN = [
    ((10, 20, 30, 40), 1, 0.9),
    ((11, 21, 31, 41), 1, 0.8),
    ((40, 18, 60, 30), 2, 0.7),
    ((1, 17, 9, 25), 0, 0.1),
]
WANTED = [("T-shirt", 0.9, centred(10, 20, 30, 40)), ("dog", 0.7, centred(40, 18, 60, 30))]


def grid_rows(count, objectness, extra=0):
    """(count, 4 or 5 + 3 + extra): the objects of SEEN in some rows, all others empty."""
    rows = np.zeros((count, 4 + objectness + 3 + extra), np.float32)
    rows[:, 2:4] = 30
    for place, ((x1, y1, x2, y2), number, score) in enumerate(SEEN):
        row = rows[7 * place + 3]
        row[:4] = (x1 + x2) / 2, (y1 + y2) / 2, x2 - x1, y2 - y1
        if objectness:
            row[4] = 0.95
        row[4 + objectness + number] = score / (0.95 if objectness else 1)
    return rows


def test_ultralytics_v8_to_v11(tmp_path):
    answer = grid_rows(ANCHORS, 0).T[None].copy()
    weights = write(tmp_path / "best.onnx", {"output0": answer}, TASK)
    check(run(tmp_path, weights), WANTED)
    family = "best.onnx: read as Ultralytics v8 to v11, 3 classes, 64 x 64 px"
    assert told(weights) == f"{family}; kept from a score of 0.25"


def test_ultralytics_v5(tmp_path):
    answer = grid_rows(3 * ANCHORS, 1)[None]
    weights = write(tmp_path / "v5.onnx", {"output0": answer}, NAMES)
    check(run(tmp_path, weights), WANTED)
    assert "YOLOv5 or YOLOv7" in told(weights)


def test_a_v5_of_one_class_is_not_read_as_final_rows(tmp_path):
    answer = np.delete(grid_rows(3 * ANCHORS, 1), (6, 7), 1)
    answer[3, 5] = 0.8
    weights = write(tmp_path / "v5.onnx", {"output0": answer[None]}, NAMES | {"names": "['cat']"})
    check(run(tmp_path, weights), [("cat", 0.76, centred(10, 20, 30, 40))])


def test_ultralytics_end_to_end(tmp_path):
    rows = np.zeros((300, 6), np.float32)
    for place in (0, 2, 3):
        box, number, score = SEEN[place]
        rows[place] = *box, score, number
    weights = write(tmp_path / "v10.onnx", {"output0": rows[None]}, TASK)
    check(run(tmp_path, weights), WANTED)


def test_yolox_with_its_decoding_inside(tmp_path):
    answer = grid_rows(ANCHORS, 1)[None]
    weights = write(tmp_path / "x.onnx", {"output": answer}, {})
    (tmp_path / "names.txt").write_text("cat\nT-shirt\ndog\n")
    # YOLOX pads right and below only.
    corner = [tuple(v / 0.32 for v in box) for box, _, _ in (SEEN[0], SEEN[2])]
    wanted = [("T-shirt", 0.9, corner[0]), ("dog", 0.7, corner[1])]
    check(run(tmp_path, weights, names=str(tmp_path / "names.txt")), wanted)


def test_yolox_raw(tmp_path):
    rows = np.zeros((ANCHORS, 8), np.float32)
    # Cell 8 * 2 + 3 of stride 8: centre 8 * (3.5, 2.25), size 8 * (2, 1).
    rows[19] = 0.5, 0.25, np.log(2), 0, 0.9, 0, 0.8, 0
    weights = write(tmp_path / "x.onnx", {"output": rows[None]}, NAMES | {"stride": ""})
    del (meta := dict(NAMES))["stride"]
    weights = write(tmp_path / "x.onnx", {"output": rows[None]}, meta)
    box = [v / 0.32 for v in (28 - 8, 18 - 4, 28 + 8, 18 + 4)]
    check(run(tmp_path, weights), [("T-shirt", 0.72, box)])


def masks_of(box, plane):
    """The share of the image's pixels inside the box where a constant plane says yes."""
    x1, y1, x2, y2 = clipped(box)
    columns = sum(x1 <= x + 0.5 < x2 for x in range(WIDTH))
    rows = sum(y1 <= y + 0.5 < y2 for y in range(HEIGHT))
    return columns * rows / (WIDTH * HEIGHT) if plane > 0 else 0.0


@pytest.mark.parametrize("final", [False, True], ids=["v8-seg", "end to end"])
def test_segmentation_with_prototypes(tmp_path, final):
    prototypes = np.zeros((1, 32, 16, 16), np.float32)
    prototypes[0, 0], prototypes[0, 1] = 1, -1
    if final:
        rows = np.zeros((1, 300, 38), np.float32)
        for place in (0, 2):
            box, number, score = SEEN[place]
            rows[0, place, :6] = *box, score, number
            rows[0, place, 6 + place // 2] = 5
        answer = rows
    else:
        rows = grid_rows(ANCHORS, 0, 32)
        rows[3, 7], rows[17, 8] = 5, 5  # terms: the first sees plane 0, the dog plane 1
        answer = rows.T[None].copy()
    meta = TASK | {"task": "segment"}
    weights = write(tmp_path / "seg.onnx", {"output0": answer, "output1": prototypes}, meta)
    row = run(tmp_path, weights)
    # The dog's plane is negative: it has no pixel and is left out.
    assert row["label"] == ["T-shirt"]
    assert row["area"] == [pytest.approx(masks_of(WANTED[0][2], 1))]


def test_tensorrt_names(tmp_path):
    outputs = {
        "num_dets": np.array([[2]], np.int32),
        "det_boxes": np.array([[SEEN[0][0], SEEN[2][0], (0, 0, 0, 0)]], np.float32),
        "det_scores": np.array([[0.9, 0.7, 0]], np.float32),
        "det_classes": np.array([[1, 2, 0]], np.int32),
    }
    weights = write(tmp_path / "v7.onnx", outputs, NAMES)
    check(run(tmp_path, weights), WANTED)
    # YOLOv6 and DAMO-YOLO export the same names for other pictures, and neither writes metadata.
    (tmp_path / "n.txt").write_text("cat\nT-shirt\ndog\n")
    weights = write(tmp_path / "v6.onnx", outputs, {})
    with pytest.raises(RsaDataError, match=r"YOLOv6 takes RGB.*DAMO-YOLO pads.*final-boxes"):
        run(tmp_path, weights, names=str(tmp_path / "n.txt"))


def test_torchvision(tmp_path):
    outputs = {
        "boxes": np.array([SEEN[0][0], SEEN[2][0]], np.float32),
        "labels": np.array([1, 2]),
        "scores": np.array([0.9, 0.7], np.float32),
    }
    check(run(tmp_path, write(tmp_path / "frcnn.onnx", outputs, NAMES)), WANTED)


def stretched(x1, y1, x2, y2):
    return [x1 * WIDTH / SIDE, y1 * HEIGHT / SIDE, x2 * WIDTH / SIDE, y2 * HEIGHT / SIDE]


def test_rtdetr_with_its_post_processing(tmp_path):
    outputs = {
        "labels": np.array([[1, 2]]),
        "boxes": np.array([[SEEN[0][0], SEEN[2][0]]], np.float32),
        "scores": np.array([[0.9, 0.7]], np.float32),
    }
    inputs = [("images", (1, 3, SIDE, SIDE), TensorProto.FLOAT)]
    inputs.append(("orig_target_sizes", (1, 2), TensorProto.INT64))
    weights = write(tmp_path / "rtdetr.onnx", outputs, NAMES, inputs)
    wanted = [("T-shirt", 0.9, stretched(*SEEN[0][0])), ("dog", 0.7, stretched(*SEEN[2][0]))]
    check(run(tmp_path, weights), wanted)


RTDETR = {
    "8.4, the best class alone": ("head", "RTDETRDecoder", 3),
    "8.4, of two classes": ("head", "RTDETRDecoder", 2),
    "before, a score a class": ("description", "Ultralytics rtdetr-l model", 3),
    "before, of two classes": ("description", "Ultralytics rtdetr-l model", 2),
}


@pytest.mark.parametrize(("key", "value", "classes"), RTDETR.values(), ids=RTDETR)
def test_ultralytics_rtdetr(tmp_path, key, value, classes):
    """Shares x y w h of the stretched picture, as its 8.3 and 8.4 export them."""
    final = key == "head"
    rows = np.zeros((1, 300, 6 if final else 4 + classes), np.float32)
    rows[0, :, :4] = 0.5, 0.5, 0.1, 0.1
    rows[0, 2, :4], rows[0, 5, :4] = (0.25, 0.5, 0.1, 0.2), (0.75, 0.25, 0.5, 0.5)
    if final:
        rows[0, 2, 4:], rows[0, 5, 4:] = (0.9, 1), (0.7, 0)
    else:
        rows[0, :, 4:] = 0.125
        rows[0, 2, 5], rows[0, 5, 4] = 0.9, 0.7
    names = "{0: 'cat', 1: 'T-shirt', 2: 'dog'}" if classes == 3 else "{0: 'cat', 1: 'T-shirt'}"
    meta = TASK | {"names": names, key: value}
    weights = write(tmp_path / "rtdetr.onnx", {"output0": rows}, meta)
    wanted = [("T-shirt", 0.9, [40, 40, 60, 60]), ("cat", 0.7, [100, 0, 200, 50])]
    check(run(tmp_path, weights), wanted)
    assert "Ultralytics RT-DETR" in told(weights)


def test_sides_that_the_export_left_open(tmp_path):
    """As dynamic=True of Ultralytics 8.4 with torch's own exporter: columns are no number."""
    answer = grid_rows(ANCHORS, 0).T[None].copy()
    weights = write(tmp_path / "best.onnx", {"output0": answer}, TASK)
    model = onnx.load(weights)
    for value, names in (
        (model.graph.input[0], ("batch", None, "height", "width")),
        (model.graph.output[0], ("batch", "Concatoutput0_dim_1", "anchors")),
    ):
        for side, name in zip(value.type.tensor_type.shape.dim, names, strict=True):
            if name:
                side.dim_param = name
    onnx.save(model, weights)
    check(run(tmp_path, weights), WANTED)


def test_yolov6_has_an_objectness_of_one(tmp_path):
    answer = grid_rows(ANCHORS, 1)[None]
    answer[0, :, 4] = 1
    answer[0, :, 5:] *= 0.95
    (tmp_path / "n.txt").write_text("cat\nT-shirt\ndog\n")
    weights = write(tmp_path / "v6.onnx", {"outputs": answer}, {})
    row = run(tmp_path, weights, names=str(tmp_path / "n.txt"))
    check(row, WANTED)
    table = pa.table({"status": ["ok"], "label": [["cat"]], "score": [[0.9]]})
    options = {"segments": "onnx", "segmenter_weights": weights, "names": str(tmp_path / "n.txt")}
    assert "YOLOv6" in detect.STAGE.notes.write([table], **options)[0]


@pytest.mark.parametrize("columns", [3, 4], ids=["sigmoid", "softmax"])
def test_detr_exports(tmp_path, columns):
    logits = np.full((1, 5, columns), -9, np.float32)
    if columns == 4:
        logits[0, :, 3] = 9  # none
    logits[0, 2] = [-9, 3, -9, -9][:columns]
    boxes = np.full((1, 5, 4), 0.5, np.float32)
    boxes[0, 2] = 0.5, 0.25, 0.5, 0.25
    outputs = {"logits": logits, "pred_boxes": boxes}
    row = run(tmp_path, write(tmp_path / "detr.onnx", outputs, NAMES))
    others = 3 * np.exp(-9.0) if columns == 4 else 0
    score = np.exp(3) / (np.exp(3) + others) if columns == 4 else 1 / (1 + np.exp(-3))
    check(row, [("T-shirt", score, [50, 12.5, 150, 37.5])])


AMBIGUOUS = {
    "yolov7 rows": ((5, 7), {}, "batch x1 y1 x2 y2 class score"),
    "six columns, no metadata": ((1, 300, 6), {}, "x1 y1 x2 y2 score class"),
    "another number of classes": ((1, 11, ANCHORS), TASK, "expected the outputs of a known family"),
    "pose": ((1, 56, ANCHORS), TASK | {"task": "pose"}, "a model of the task 'pose'"),
}


@pytest.mark.parametrize(("shape", "meta", "says"), AMBIGUOUS.values(), ids=AMBIGUOUS)
def test_what_can_be_read_in_two_ways_is_refused(tmp_path, shape, meta, says):
    weights = write(tmp_path / "m.onnx", {"output": np.zeros(shape, np.float32)}, NAMES | meta)
    if "task" not in meta:
        weights = write(tmp_path / "m.onnx", {"output": np.zeros(shape, np.float32)}, {})
        (tmp_path / "names.txt").write_text("cat\nT-shirt\ndog\n")
        with pytest.raises(RsaDataError, match=says) as caught:
            run(tmp_path, weights, names=str(tmp_path / "names.txt"))
        assert "--card" in str(caught.value)
        return
    with pytest.raises(RsaDataError, match=says):
        run(tmp_path, weights)


def test_a_file_without_names_asks_for_them(tmp_path):
    answer = grid_rows(ANCHORS, 0).T[None].copy()
    with pytest.raises(RsaDataError, match="--names"):
        run(tmp_path, write(tmp_path / "m.onnx", {"output0": answer}, {}))


CARD = """
kind = "segments"
[input]
name = "images"
resize = "letterbox"
size = [64, 64]
[output]
rows = "output"
[decoder]
family = "final-rows"
columns = ["batch", "x1", "y1", "x2", "y2", "class", "score"]
coordinates = "{coordinates}"
score_threshold = 0.3
[classes]
names = ["cat", "dog"]
"""


def test_a_card_names_the_columns(tmp_path):
    rows = np.array([[0, 10, 20, 30, 40, 1, 0.9], [0, 0, 0, 9, 9, 0, 0.2]], np.float32)
    weights = write(tmp_path / "v7.onnx", {"output": rows}, {})
    (tmp_path / "mine.toml").write_text(CARD.format(coordinates="input"))
    row = run(tmp_path, weights, card=tmp_path / "mine.toml")
    check(row, [("dog", 0.9, [v / 0.32 for v in (10, 20, 30, 40)])])


IMPOSSIBLE = {
    "shares": ([0, 0.2, 0.3, 0.6, 0.7, 1, 0.9], "all boxes lie within 0 to 1 px"),
    "huge": ([0, 0, 0, 1e8, 40, 1, 0.9], "a box reaches to"),
    "beyond all numbers": ([0, 0, 0, 9, 9, 3e38, 0.9], "numbers up to 3e+38"),
    "nan": ([0, np.nan, 0, 10, 40, 1, 0.9], "holds nan or inf"),
    "another class": ([0, 10, 20, 30, 40, 79, 0.9], "the model answers with class 79"),
}


@pytest.mark.parametrize(("values", "says"), IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_numbers_that_cannot_be_fail_the_row(tmp_path, values, says):
    weights = write(tmp_path / "v7.onnx", {"output": np.array([values], np.float32)}, {})
    (tmp_path / "mine.toml").write_text(CARD.format(coordinates="input"))
    row = run(tmp_path, weights, card=tmp_path / "mine.toml")
    assert row["status"] == "failed" and says in row["error"]
    if says.startswith("all boxes"):
        (tmp_path / "mine.toml").write_text(CARD.format(coordinates="shares"))
        row = run(tmp_path, weights, card=tmp_path / "mine.toml")
        assert row["status"] == "ok" and row["label"] == ["dog"]


def test_another_yolox_under_the_shipped_card_is_refused(tmp_path):
    answer = np.concatenate([grid_rows(3549, 1), np.zeros((3549, 77), np.float32)], 1)[None]
    inputs = [("images", (1, 3, 416, 416), TensorProto.FLOAT)]
    weights = write(tmp_path / "decoded.onnx", {"output": answer}, {}, inputs)
    Image.new("RGB", (50, 40)).save(tmp_path / "a.png")
    step = detect.build(
        dataset=DATASET, root=tmp_path, segments="yolox-nano", segmenter_weights=weights
    )
    with pytest.raises(RsaDataError, match="decode_in_inference"):
        step(pa.table({"sample_id": ["a"], "image": ["a.png"]}))
    lines = detect.STAGE.notes.write([], segments="yolox-nano", segmenter_weights=weights)
    assert "is not the file that the card yolox-nano was written for" in lines[0]
    assert "--preview" in lines[0]
