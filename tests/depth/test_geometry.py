"""Which part of a photo the depth model sees, at which size, and where its map lies."""

import cv2
import numpy as np
import pytest

from rsa_data.common.errors import RowError, UsageError
from rsa_data.depth import onnx
from rsa_data.depth.measure import at_size
from rsa_data.depth.model import Relative


def test_at_size_is_bicubic_inside_the_box_and_nan_outside():
    y = np.random.default_rng(0).random((5, 5)).astype(np.float32)
    whole = at_size(Relative(y, (0.25, 0.1, 0.75, 0.9)), 20, 40)
    inside = cv2.resize(y, (20, 16), interpolation=cv2.INTER_CUBIC)
    np.testing.assert_array_equal(whole[2:18, 10:30], inside)
    assert np.isnan(whole).sum() == 20 * 40 - 20 * 16
    assert at_size(Relative(y), 5, 5) is y


@pytest.mark.parametrize(
    ("card", "shape", "seen", "part"),
    [
        ({"resize": "squash", "width": 256, "height": 256}, (480, 640), (256, 256), (0, 0, 1, 1)),
        # Sizes that DPTImageProcessor of transformers gives, see the test below.
        (
            {"resize": "keep-aspect", "size": 518, "multiple": 14},
            (480, 640),
            (518, 686),
            (0, 0, 1, 1),
        ),
        (
            {"resize": "keep-aspect", "size": 518, "multiple": 14},
            (400, 700),
            (294, 518),
            (0, 0, 1, 1),
        ),
        (
            {"resize": "centre-crop", "short": 240, "size": 224},
            (480, 640),
            (224, 224),
            (0.15, 1 / 30, 0.85, 29 / 30),
        ),
    ],
    ids=["squash", "keep-aspect", "keep-aspect of one larger and one smaller side", "centre-crop"],
)
def test_what_the_model_sees(card, shape, seen, part):
    image = np.zeros((*shape, 3), np.uint8)
    found, box = onnx.RESIZES[card["resize"]](card)(image)
    assert found.shape == (*seen, 3)
    assert box == pytest.approx(part)


@pytest.mark.parametrize(
    "shape", [(480, 640), (375, 1242), (1216, 1936), (640, 480), (100, 90), (400, 700)]
)
def test_keep_aspect_sizes_equal_transformers(shape):
    dpt = pytest.importorskip("transformers.models.dpt.image_processing_pil_dpt")
    size = dpt.get_resize_output_image_size(np.zeros((3, *shape)), (518, 518), True, 14)
    card = {"size": 518, "multiple": 14}
    found, _ = onnx.RESIZES["keep-aspect"](card)(np.zeros((*shape, 3), np.uint8))
    assert found.shape[:2] == (size["height"], size["width"])


def test_kittis_crop_and_a_crop_inside_it():
    box = onnx.kb_box(375, 1242)
    assert onnx.cut(np.zeros((375, 1242, 3)), box).shape == (352, 1216, 3)
    assert onnx.inside(box, (0, 0, 1, 1)) == pytest.approx(box)
    assert onnx.inside((0.5, 0, 1, 1), (0.5, 0.5, 1, 1)) == (0.75, 0.5, 1, 1)
    with pytest.raises(RowError, match="at least 1216x352"):
        onnx.kb_box(300, 1242)


@pytest.mark.parametrize("text", ["434", "x", "0x4", "4x4x4"])
def test_a_bad_geometry_is_refused(text):
    with pytest.raises(UsageError, match="WIDTHxHEIGHT"):
        onnx.fixed(text)
