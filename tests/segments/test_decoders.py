"""Decoders against other people's code, closed forms and per-pixel loops, without any graph."""

import math

import numpy as np
import pytest

from rsa_data.common.class_names import ClassTable
from rsa_data.registry import DECODERS, resolve
from rsa_data.segments import boxes, decoding, masks
from rsa_data.segments.found import to_segments
from rsa_data.segments.preprocess import Geometry, preprocessor, shortest_size

TABLE = ClassTable({0: "a", 1: "b", 2: "c"}, frozenset({0, 1}), 3)


def decode(family, settings, outputs, geometry, table=TABLE):
    return resolve("decoder", DECODERS, family)(settings, table).decode(outputs, geometry)


def square(side, width=None, height=None):
    """An image that fills a square input of `side` px, itself width x height px."""
    return Geometry(width or side, height or side, side, side, side, side)


@pytest.mark.parametrize("seed", range(5))
def test_suppression_keeps_what_opencv_keeps(seed):
    import cv2

    rng = np.random.default_rng(seed)
    corner, size = rng.uniform(0, 80, (200, 2)), rng.uniform(5, 40, (200, 2))
    box = np.concatenate([corner, corner + size], 1).astype(np.float32)
    score = rng.uniform(0, 1, 200).astype(np.float32)
    number = rng.integers(0, 3, 200)
    xywh = np.concatenate([box[:, :2], box[:, 2:] - box[:, :2]], 1).astype(np.float64)
    theirs = cv2.dnn.NMSBoxesBatched(xywh, score, number, 0.0, 0.45)
    assert boxes.suppress(box, score, number, 0.45).tolist() == np.ravel(theirs).tolist()


def test_suppression_of_nothing():
    empty = np.zeros((0, 4)), np.zeros(0), np.zeros(0, int)
    assert boxes.suppress(*empty, 0.5).tolist() == []


def test_yolox_by_hand():
    rows = np.zeros((1, 21, 8), np.float32)  # 32 px, strides 8, 16, 32: 16 + 4 + 1 cells
    rows[0, 6, :4] = 0.5, 0.25, math.log(2), 0.0  # cell x 2, y 1 of stride 8
    rows[0, 6, 4:] = 0.8, 0.1, 0.9, 0.2
    rows[0, 20, :4] = 0, 0, math.log(4), 0  # the only cell of stride 32
    rows[0, 20, 4:] = 0.9, 0.5, 0.0, 0.0
    settings = {"score_threshold": 0.4, "overlap_threshold": 0.45}
    # An image of 64 x 32 px in a letterbox of 32 x 32: half the size, the lower half is padding.
    geometry = Geometry(64, 32, 32, 16, 32, 32)
    found = decode("yolox", settings, {"predictions": rows}, geometry)
    assert found.number.tolist() == [1, 0]
    np.testing.assert_allclose(found.score, [0.72, 0.45], rtol=1e-6)
    center, size = np.array([(2 + 0.5) * 8, (1 + 0.25) * 8]), np.array([16, 8])
    expected = np.concatenate([center - size / 2, center + size / 2]) * 2
    np.testing.assert_allclose(found.box[0], expected, rtol=1e-6)
    segments = to_segments(found, 64, 32, TABLE)
    np.testing.assert_array_equal(segments.box[1], [0, 0, 64, 32])
    assert segments.area[1] == 1.0


def test_fastestdet_by_hand():
    maps = np.zeros((1, 8, 2, 2), np.float32)
    maps[0, :, 1, 0] = 0.9, math.atanh(0.5), 0, 0, math.log(3), 0.1, 0.2, 0.8
    settings = {"score_threshold": 0.65, "overlap_threshold": 0.45}
    found = decode("fastestdet", settings, {"predictions": maps}, square(100))
    assert found.number.tolist() == [2]
    np.testing.assert_allclose(found.score, [0.9**0.6 * 0.8**0.4], rtol=1e-6)
    # centre (0.25, 0.5), size (0.5, 0.75) of the input
    np.testing.assert_allclose(found.box, [[0, 12.5, 50, 87.5]], atol=1e-4)


def test_nanodet_by_hand():
    outputs = {}
    for stride, count in ((8, 4), (16, 1)):
        outputs[f"classes_{stride}"] = np.zeros((1, count, 3), np.float32)
        outputs[f"boxes_{stride}"] = np.zeros((1, count, 4 * 8), np.float32)
    outputs["classes_8"][0, 3, 1] = 0.7
    # One bin is certain for each side: left 1, top 2, right 0, bottom 3, times the stride.
    for side, distance in enumerate((1, 2, 0, 3)):
        outputs["boxes_8"][0, 3, side * 8 + distance] = 100
    settings = {"strides": [8, 16], "score_threshold": 0.4, "overlap_threshold": 0.6}
    found = decode("nanodet", settings, outputs, square(16))
    assert (found.number.tolist(), found.score.tolist()) == ([1], [pytest.approx(0.7)])
    x = y = 8 + 3.5
    np.testing.assert_allclose(found.box, [[x - 8, y - 16, x, y + 24]], atol=1e-4)


def test_paddle_rows():
    rows = np.array([[-1, 0, 0, 0, 0, 0], [1, 0.3, 1, 2, 3, 4], [2, 0.9, 5, 6, 70, 80]], np.float32)
    outputs = {"rows": rows}
    found = decode("nms-rows", {"score_threshold": 0.2}, outputs, square(32, 60, 60))
    assert found.number.tolist() == [2, 1]
    np.testing.assert_array_equal(found.box, rows[[2, 1], 2:])
    segments = to_segments(found, 60, 60, TABLE)
    np.testing.assert_array_equal(segments.box, [[5, 6, 60, 60], [1, 2, 3, 4]])
    assert segments.area.tolist() == [55 * 54 / 3600, 4 / 3600]


@pytest.mark.parametrize("seed", range(3))
def test_pasted_masks_are_torchs(seed):
    import torch

    rng = np.random.default_rng(seed)
    mask = rng.uniform(0, 1, (28, 28)).astype(np.float32)
    height, width = 40, 60
    x1, y1, x2, y2 = 7.3, -3.2, 51.9, 33.6
    y = ((np.arange(height) + 0.5 - y1) / (y2 - y1) * 2 - 1).astype(np.float32)
    x = ((np.arange(width) + 0.5 - x1) / (x2 - x1) * 2 - 1).astype(np.float32)
    grid = torch.from_numpy(np.stack(np.meshgrid(x, y), -1))[None]
    # As detectron2 pastes: zeros outside, corners not aligned.
    theirs = torch.nn.functional.grid_sample(
        torch.from_numpy(mask)[None, None], grid, align_corners=False
    )[0, 0]
    ours = masks.paste(mask, np.array([x1, y1, x2, y2]), height, width)
    np.testing.assert_allclose(ours, theirs.numpy(), atol=1e-4)


def test_instances():
    outputs = {
        "boxes": np.array([[0, 0, 4, 4], [4, 2, 8, 6], [0, 0, 1, 1]], np.float32),
        "scores": np.array([0.6, 0.9, 0.1], np.float32),
        "classes": np.array([0, 2, 1]),
        "masks": np.ones((3, 1, 2, 2), np.float32),
    }
    settings = {"score_threshold": 0.5, "masks_show": "box"}
    found = decode("instances", settings, outputs, square(8))
    segments = to_segments(found, 8, 8, TABLE)
    assert segments.label == ["c", "a"]
    np.testing.assert_array_equal(segments.box, [[4, 2, 8, 6], [0, 0, 4, 4]])
    assert segments.area.tolist() == [16 / 64, 16 / 64]
    whole = outputs | {"masks": np.eye(3, dtype=np.float32)[:, :, None].repeat(8, 2)[:, None]}
    found = decode("instances", settings | {"masks_show": "input"}, whole, square(8))
    assert [mask.shape for mask in found.masks] == [(8, 8), (8, 8)]


@pytest.mark.parametrize(
    ("size", "wanted"), [((7, 9), (31, 20)), ((50, 60), (25, 31)), ((8, 8), (8, 8))]
)
def test_resized_maps_are_torchs(size, wanted):
    import torch

    values = np.random.default_rng(0).normal(size=size).astype(np.float32)
    theirs = torch.nn.functional.interpolate(
        torch.from_numpy(values)[None, None], size=wanted, mode="bilinear", align_corners=False
    )[0, 0].numpy()
    np.testing.assert_allclose(masks.resize(values, *wanted), theirs, atol=1e-5)
    # The way for padded inputs, when nothing is padded.
    np.testing.assert_allclose(
        masks.resize(values, *wanted, (1 - 1e-12, 1.0, 0.0, 0.0)), theirs, atol=2e-5
    )


def test_padding_is_left_out_of_resized_maps():
    ramp = np.arange(16, dtype=np.float32)[None].repeat(8, 0)  # one value a column of the input
    found = masks.resize(ramp, 4, 8, (0.5, 0.5, 0.0, 0.0))
    np.testing.assert_allclose(found, np.arange(8, dtype=np.float32)[None].repeat(4, 0))


def random_queries(seed, queries=7, classes=3, size=(6, 8)):
    rng = np.random.default_rng(seed)
    blobs = np.stack(
        [
            4 - 12 * np.hypot(*np.ogrid[-y : 1 - y : 6j, -x : 1 - x : 8j])
            for y, x in rng.uniform(0, 1, (queries, 2))
        ]
    )
    return {
        "classes": rng.normal(0, 2, (1, queries, classes)).astype(np.float32),
        "masks": (blobs + rng.normal(0, 0.5, blobs.shape)).astype(np.float32)[None],
    }


MASKDINO = {
    "score": "maskdino",
    "score_threshold": 0.25,
    "own_threshold": 0.5,
    "overlap_threshold": 0.8,
    "overlap_inclusive": True,
    "overlap_weighted": False,
    "sigmoid": "last",
    "merge_stuff": True,
}


def maskdino_loop(outputs, overlap):
    """MaskDINO's panoptic inference, pixel by pixel, at the masks' own size."""
    logits, mask = outputs["classes"][0].astype(float), outputs["masks"][0].astype(float)
    sigmoid = lambda x: 1 / (1 + math.exp(-x))  # noqa: E731
    kept, height, width = [], *mask.shape[1:]
    for query, row in enumerate(logits):
        single = [sigmoid(x) for x in row]
        if max(single) > 0.25:
            sharp = [math.exp(x / 0.06) for x in single]
            kept.append((query, single.index(max(single)), max(sharp) / sum(sharp)))
    owner, reach, won = {}, [0] * len(kept), [0] * len(kept)
    for y in range(height):
        for x in range(width):
            values = [sigmoid(mask[query, y, x]) for query, _, _ in kept]
            scored = [value * score for value, (_, _, score) in zip(values, kept, strict=True)]
            best = scored.index(max(scored))
            won[best] += 1
            for k, value in enumerate(values):
                reach[k] += value >= 0.5
            owner[y, x] = best if values[best] >= 0.5 else None
    segments, stuff = [], {}
    for k, (_, number, score) in enumerate(kept):
        own = [pixel for pixel, best in owner.items() if best == k]
        if not (won[k] and reach[k] and own) or won[k] / reach[k] < overlap:
            continue
        if number not in TABLE.things and number in stuff:
            stuff[number].update(own)
            continue
        segments.append((TABLE.names[number], score, set(own)))
        if number not in TABLE.things:
            stuff[number] = segments[-1][2]
    return segments


@pytest.mark.parametrize("seed", range(12))
def test_maskdino_against_a_loop_over_pixels(seed):
    outputs = random_queries(seed)
    settings = MASKDINO | {"overlap_threshold": 0.6}
    found = decode("panoptic-queries", settings, outputs, Geometry(8, 6, 8, 6, 8, 6))
    assert found.candidates == 7  # queries
    segments = to_segments(found, 8, 6, TABLE)
    expected = maskdino_loop(outputs, 0.6)
    assert len(expected) >= 1
    assert segments.label == [label for label, _, _ in expected]
    np.testing.assert_allclose(segments.score, [score for _, score, _ in expected], atol=1e-6)
    assert segments.area.tolist() == [len(pixels) / 48 for _, _, pixels in expected]
    corners = [
        [
            min(x for _, x in p),
            min(y for y, _ in p),
            max(x for _, x in p) + 1,
            max(y for y, _ in p) + 1,
        ]
        for _, _, p in expected
    ]
    assert segments.box.tolist() == corners


def test_maskdino_masks_leave_out_the_padding():
    outputs = random_queries(3)
    settings = MASKDINO | {"through": "input", "overlap_threshold": 0.0, "merge_stuff": False}
    whole = decode("panoptic-queries", settings, outputs, Geometry(32, 24, 32, 24, 32, 24))
    # The same input, of which the lower quarter is padding: the same masks, cut.
    cut = decode("panoptic-queries", settings, outputs, Geometry(32, 18, 32, 18, 32, 24))
    queries = [np.append(found.query, -1)[found.index] for found in (whole, cut)]
    np.testing.assert_array_equal(queries[1], queries[0][:18])


def test_nothing_passes_the_threshold():
    settings = MASKDINO | {"score": "softmax", "score_threshold": 1.0}
    found = decode("panoptic-queries", settings, random_queries(0, classes=4), square(8))
    assert to_segments(found, 8, 8, TABLE).label == []


@pytest.mark.parametrize("layout", ["NCHW", "NHWC"])
def test_semantic_maps(layout):
    import torch

    values = np.random.default_rng(1).normal(0, 3, (1, 4, 5, 6)).astype(np.float32)
    table = ClassTable({1: "a", 2: "b", 3: "c"}, frozenset({1}), 4)  # 0 is the background
    outputs = {"map": values.transpose(0, 2, 3, 1) if layout == "NHWC" else values}
    geometry = square(32, 33, 21)
    found = decode("semantic", {"layout": layout}, outputs, geometry, table)
    segments = to_segments(found, 33, 21, table)
    # As transformers' post_process_semantic_segmentation: logits resized, then the largest.
    resized = torch.nn.functional.interpolate(
        torch.from_numpy(values), size=(21, 33), mode="bilinear", align_corners=False
    )[0]
    winner = resized.argmax(0).numpy()
    share = torch.nn.functional.interpolate(
        torch.from_numpy(values).softmax(1).amax(1, keepdim=True), size=(21, 33), mode="bilinear"
    )[0, 0].numpy()
    there = [number for number in (1, 2, 3) if (winner == number).any()]
    assert segments.label == [table.names[number] for number in there]
    assert segments.area.tolist() == [(winner == n).sum() / (33 * 21) for n in there]
    scores = [share[winner == number].mean() for number in there]
    np.testing.assert_allclose(segments.score, scores, atol=1e-5)
    assert segments.is_thing.tolist() == [False] * len(there)


def test_semantic_components():
    from scipy import ndimage

    values = np.random.default_rng(2).normal(0, 3, (1, 3, 12, 12)).astype(np.float32)
    found = decode("semantic", {"components": True}, {"map": values}, square(12))
    segments = to_segments(found, 12, 12, TABLE)
    winner = values[0].argmax(0)
    expected = []
    for number in range(3):
        parts, count = ndimage.label(winner == number, np.ones((3, 3)))
        expected += [(TABLE.names[number], (parts == k + 1).sum() / 144) for k in range(count)]
    assert sorted(zip(segments.label, segments.area, strict=True)) == sorted(expected)
    assert segments.is_thing.tolist() == [label != "c" for label in segments.label]


def test_regions_against_a_loop():
    index = np.random.default_rng(0).integers(-1, 4, (9, 13))
    pixels, box, center, _ = masks.regions(index, 5)
    for k in range(5):
        y, x = np.nonzero(index == k)
        assert pixels[k] == len(x)
        if len(x):
            assert box[k].tolist() == [x.min(), y.min(), x.max() + 1, y.max() + 1]
            np.testing.assert_allclose(center[k], [x.mean() + 0.5, y.mean() + 0.5], rtol=1e-6)
        else:
            assert box[k].tolist() == [0, 0, 0, 0]


def test_sigmoid_and_softmax_do_not_overflow():
    values = np.array([-1e4, -1.0, 0.0, 1.0, 1e4], np.float32)
    np.testing.assert_allclose(decoding.sigmoid(values)[[0, 2, 4]], [0, 0.5, 1])
    assert decoding.softmax(values).sum() == pytest.approx(1)


@pytest.mark.parametrize(
    "size", [(480, 640), (427, 640), (640, 480), (800, 800), (100, 3000), (1333, 800), (37, 53)]
)
def test_sides_are_those_of_transformers(size):
    from transformers.image_transforms import get_size_with_aspect_ratio

    assert shortest_size(*size, 800, 1333) == get_size_with_aspect_ratio(size, 800, 1333)


def test_letterbox_is_yoloxs():
    import cv2

    image = np.random.default_rng(0).integers(0, 256, (48, 100, 3), dtype=np.uint8)
    spec = {"resize": "letterbox", "size": [64, 64], "pad": 114, "colour": "BGR"}
    tensor, geometry = preprocessor(spec, "card")(image)
    # yolox.data.data_augment.preproc on the BGR image
    expected = np.full((64, 64, 3), 114, np.uint8)
    expected[:30, :64] = cv2.resize(image[:, :, ::-1], (64, 30), interpolation=cv2.INTER_LINEAR)
    np.testing.assert_array_equal(tensor[0], expected.transpose(2, 0, 1).astype(np.float32))
    assert geometry == Geometry(100, 48, 64, 30, 64, 64)


@pytest.mark.parametrize("layout", ["NCHW", "NHWC"])
def test_values_and_padding(layout):
    image = np.full((3, 5, 3), (10, 20, 30), np.uint8)
    spec = {
        "resize": "shortest",
        "shortest": 3,
        "longest": 9,
        "pad_multiple": 4,
        "layout": layout,
        "mean": [1, 2, 3],
        "std": [2, 4, 8],
    }
    tensor, geometry = preprocessor(spec, "card")(image)
    assert tensor.dtype == np.float32
    values = tensor[0] if layout == "NHWC" else tensor[0].transpose(1, 2, 0)
    expected = np.zeros((4, 8, 3), np.float32)
    expected[:3, :5] = 4.5, 4.5, 3.375
    np.testing.assert_array_equal(values, expected)
    assert geometry == Geometry(5, 3, 5, 3, 8, 4)
