"""What a depth model is shown: numbers as torchvision's ToTensor and Normalize make them."""

import cv2
import numpy as np
import pytest

from rsa_data.depth import onnx


def test_pixels_are_those_of_totensor_and_normalize():
    image = np.random.default_rng(0).integers(0, 256, (4, 6, 3), np.uint8)
    mean, std = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet
    found = onnx.normalise(image, {"mean": mean, "std": std})
    expected = (np.moveaxis(image, 2, 0) / 255 - np.reshape(mean, (3, 1, 1))) / np.reshape(
        std, (3, 1, 1)
    )
    np.testing.assert_allclose(found, expected[None], rtol=1e-5, atol=1e-6)
    assert found.dtype == np.float32 and found.flags["C_CONTIGUOUS"]
    plain = onnx.normalise(image, {})
    np.testing.assert_allclose(plain, np.moveaxis(image, 2, 0)[None] / 255, rtol=1e-6)


def test_a_centre_crop_shows_the_middle():
    """The short side becomes 40 px; of 80 x 40 the middle 30 x 30 is seen."""
    found, box = onnx.RESIZES["centre-crop"]({"short": 40, "size": 30})(
        np.zeros((20, 40, 3), np.uint8)
    )
    assert found.shape == (30, 30, 3)
    assert box == pytest.approx((25 / 80, 5 / 40, 55 / 80, 35 / 40))


def test_an_image_as_large_as_the_model_sees_it_is_left_as_it_is():
    image = np.random.default_rng(1).integers(0, 256, (14, 28, 3), np.uint8)
    found, box = onnx.fixed("28x14")(image)
    np.testing.assert_array_equal(found, image)
    assert box == (0, 0, 1, 1)
    larger, _ = onnx.fixed("56x14")(image)
    assert larger.shape == (14, 56, 3)


@pytest.mark.parametrize(("side", "how"), [(80, cv2.INTER_AREA), (20, cv2.INTER_CUBIC)])
def test_a_centre_crop_averages_what_it_shrinks(side, how):
    image = np.random.default_rng(2).integers(0, 256, (side, side, 3), np.uint8)
    found, _ = onnx.RESIZES["centre-crop"]({"short": 40, "size": 40})(image)
    np.testing.assert_array_equal(found, cv2.resize(image, (40, 40), interpolation=how))


def test_a_part_of_a_part():
    assert onnx.inside((0.5, 0.25, 1, 0.75), (0.5, 0.1, 1, 0.5)) == pytest.approx(
        (0.75, 0.3, 1, 0.5)
    )
