"""Fixtures of the tests of segments."""

import pytest
from own_models import CARD, write_semantic
from PIL import Image


@pytest.fixture
def own(tmp_path):
    """The options of a model of one's own, and a folder with three pictures."""
    (tmp_path / "card.toml").write_text(CARD)
    write_semantic(tmp_path / "m.onnx")
    for name, colour in (("r", (200, 0, 0)), ("g", (0, 200, 0)), ("b", (0, 0, 200))):
        Image.new("RGB", (6, 5), colour).save(tmp_path / f"{name}.png")
    return {
        "segments": "mine",
        "segmenter_weights": tmp_path / "m.onnx",
        "card": tmp_path / "card.toml",
    }
