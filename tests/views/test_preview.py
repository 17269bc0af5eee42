"""The contact sheet of detect --preview."""

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from rsa_data.cli.main import cli
from rsa_data.common.errors import RowError
from rsa_data.segments import masks
from rsa_data.segments.segments import Segments, from_row, to_table
from rsa_data.views.pictures import preview
from rsa_data.views.pictures.colours import SEGMENT_COLOURS


def found(**more):
    return Segments(
        label=["sea", "sky"],
        area=np.array([0.5, 0.25]),
        score=np.array([1, 0.5], np.float32),
        is_thing=np.zeros(2, bool),
        box=np.array([[0, 4, 8, 8], [0, 0, 4, 4]], np.float32),
        width=8,
        height=8,
        **more,
    )


def test_segments_survive_the_table():
    feature = np.arange(6, dtype=np.float32).reshape(2, 3)
    left = found(feature=feature, mask=["a", "b"])
    table = to_table(["x", "y"], [left, RowError("broken")])
    right, error = map(from_row, table.to_pylist())
    assert str(error) == "broken"
    assert to_table(["x", "y"], [right, error]).equals(table)
    np.testing.assert_array_equal(right.feature, feature)


def test_masks_are_drawn_where_they_are(tmp_path):
    Image.new("RGB", (8, 8), (10, 10, 10)).save(tmp_path / "a.png")
    lower = np.zeros((8, 8), bool)
    lower[4:] = True
    upper = np.zeros((8, 8), bool)
    upper[:4, :4] = True
    segments = found(mask=masks.encode([lower, upper]))
    picture, text = preview.draw(tmp_path, {"sample_id": "d/a", "image": "a.png"}, segments)
    assert text == "d/a\nsea 50.0%, sky 25.0%"
    height, width = picture.shape[:2]
    spot = lambda y, x: picture[int(y * height), int(x * width)].astype(int)  # noqa: E731
    assert spot(0.25, 0.75).tolist() == [10, 10, 10]
    for place, colour in (((0.97, 0.97), SEGMENT_COLOURS[0]), ((0.02, 0.02), SEGMENT_COLOURS[1])):
        tint = (spot(*place) - 10) / (colour.astype(int) - 10)
        assert np.ptp(tint) < 0.4
        assert 0.3 < np.median(tint) <= 1


def test_what_cannot_be_shown_is_told(tmp_path):
    sample = {"sample_id": "d/a", "image": "none.png"}
    assert preview.draw(tmp_path, sample, found())[1] == "d/a\nno such file"
    Image.new("RGB", (8, 8)).save(tmp_path / "none.png")
    assert preview.draw(tmp_path, sample, RowError("nan"))[1] == "d/a\nfailed: nan"


def test_the_command_draws_a_sheet(tmp_path, monkeypatch):
    pytest.importorskip("onnx")
    from own_models import CARD, write_semantic

    monkeypatch.chdir(tmp_path)
    (tmp_path / "images").mkdir()
    for k in range(7):
        Image.new("RGB", (80, 60), (200, 0, 0)).save(tmp_path / "images" / f"{k}.png")
    (tmp_path / "mine.toml").write_text(CARD)
    write_semantic(tmp_path / "m.onnx")
    arguments = (
        "detect --dataset folder:trip --root images --segments mine --segmenter-weights m.onnx"
    )
    done = CliRunner().invoke(cli, [*arguments.split(), "--card", "mine.toml", "--preview", "5"])
    assert done.exit_code == 0, done.output
    assert "preview: preview-trip-mine.png" in done.output
    sheet = np.asarray(Image.open("preview-trip-mine.png"))
    assert sheet.shape[1] > 3 * 480
    red = (sheet == (200, 0, 0)).all(2)
    assert red.sum() > 4 * 480 * 300  # five pictures, less their labels and frames
