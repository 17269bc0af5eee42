"""Cards of the user's own, from the first command to metres, each next command as it is printed."""

import json
import re
import shlex

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from own_models import CARD, write_graph, write_semantic
from PIL import Image

from rsa_data.cli.main import cli
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.depth import choice, measure
from rsa_data.store.tables import WorkDir

DEPTH_CARD = """
kind = "relative-depth"
resize = "squash"
width = 8
height = 6
output = "depth"
output_name = "metres"
"""


def run(line: str, code: int = 0) -> str:
    """A line as somebody would type it; what it printed, or its error where it shall fail."""
    done = CliRunner().invoke(cli, shlex.split(line.removeprefix("rsa-data ")))
    failed = done.exception is not None and not isinstance(done.exception, SystemExit)
    said = done.output + (str(done.exception) if failed else "")
    assert (done.exit_code if not failed else 1) == code, (line, said)
    assert not failed or isinstance(done.exception, RsaDataError), done.exception
    return said


def following(output: str) -> str:
    """The command of the next: line."""
    (line,) = re.findall(r"^next: (rsa-data .*)$", output, re.MULTILINE)
    return line


def write_depth(path):
    """A graph with two outputs: of each pixel's grey 0 to 1, itself plus 1 as depth, and a sum."""
    return write_graph(
        path,
        [
            ("ReduceMean", ["x"], ["grey"], {"axes": [1], "keepdims": 1}),
            ("Add", ["grey", "one"], ["metres"]),
            ("ReduceSum", ["x"], ["sum"], {"keepdims": 0}),
        ],
        [("x", [1, 3, 6, 8])],
        [("sum", []), ("metres", [1, 1, 6, 8])],
        [("one", np.float32(1))],
    )


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder `set` of grey images in rooms, whose depth in m is 1 + the grey, and a label map."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    for k in range(12):
        for kind in ("set/rgb", "set/depth", "maps/rgb"):
            (tmp_path / kind / f"room{k % 4}").mkdir(parents=True, exist_ok=True)
        grey = rng.integers(10, 250, (6, 8)).astype(np.uint8)
        where = f"room{k % 4}/{k}.png"
        Image.fromarray(np.repeat(grey[:, :, None], 3, 2)).save(f"set/rgb/{where}")
        cv2.imwrite(f"set/depth/{where}", np.round(1000 + grey / 0.255).astype(np.uint16))
        cv2.imwrite(f"maps/rgb/{where}", np.ones((6, 8), np.uint8))
    (tmp_path / "mine.toml").write_text(CARD)
    write_semantic(tmp_path / "m.onnx")
    write_depth(tmp_path / "d.onnx")
    (tmp_path / "depth.toml").write_text(DEPTH_CARD)
    return tmp_path


SET = (
    "--dataset folder:rooms --root set --dataset-option images=rgb --dataset-option depth=depth "
    "--dataset-option depth_unit=mm --dataset-option test_share=0.25"
)


def test_a_detector_of_ones_own_beside_another_table(here):
    run(f"detect {SET} --segments labels:maps/{{path}}.png --names nyu13")
    broken = CARD.replace('map = "y"', 'map = "q"')
    (here / "mine.toml").write_text(broken)
    said = run(f"detect {SET} --card mine.toml --segmenter-weights m.onnx", code=1)
    assert "expected the output q" in said
    (here / "mine.toml").write_text(CARD)
    captions = following(run(f"detect {SET} --card mine.toml --segmenter-weights m.onnx"))
    assert captions == "rsa-data captions --dataset rooms --segments mine"
    embed = following(run(captions))
    work = WorkDir(here / "work")
    table = work.table("rooms", "captions/occupancy")
    assert table.description().inputs[0] == "segments/mine"
    assert embed == "rsa-data embed --dataset rooms"


def test_a_depth_model_of_ones_own_to_metres(here):
    (here / "depth.toml").write_text(DEPTH_CARD.replace("metres", "feet"))
    said = run(f"depth {SET} --card depth.toml --depth-weights d.onnx", code=1)
    assert "one of the file's outputs sum, metres; found feet" in said
    (here / "depth.toml").write_text(DEPTH_CARD)
    run(f"embed-images {SET} --encoder thumbnail")
    made = run("depth --dataset rooms --card depth.toml --depth-weights d.onnx")
    assert "grows with the distance" not in made and "ground truth: median 1.5" in made
    trained = run(f"{following(made)} --epochs 2 --validation 0.4 --head linear")
    description = WorkDir(here / "work").table("rooms", "depth/depth").description()
    assert sorted(description.files) == ["card", "model"]
    # y is the inverse of the graph's answer, which is the ground truth: its own fit is exact.
    rows = WorkDir(here / "work").table("rooms", "depth/depth").read(0).to_pylist()
    assert [row["fit_scale"] for row in rows] == pytest.approx([1] * len(rows), abs=0.01)
    assert "AbsRel" in run(following(trained))
    metres = cv2.imread("set/depth/room0/0.png", cv2.IMREAD_UNCHANGED) / 1000
    known = f"--known 1,1,{metres[1, 1]} --known 5,4,{metres[4, 5]} --known 7,0,{metres[0, 7]}"
    own = "--depth-card depth.toml --depth-weights d.onnx"
    (found,) = json.loads(run(f"predict set/rgb/room0/0.png {known} {own} --json"))
    assert found["depth"]["median"] == pytest.approx(np.median(metres), rel=0.01)


BAD = {
    "kind": ('kind = "segments"\n', 'expected kind = "relative-depth"'),
    "resize": (
        DEPTH_CARD.replace("squash", "squeeze"),
        "Choices: centre-crop, keep-aspect, squash",
    ),
    "output": (DEPTH_CARD.replace('"depth"\n', '"metres"\n'), "Choices: depth, inverse"),
    "side": (DEPTH_CARD.replace("width = 8", ""), "expected width in px"),
    "mean": (DEPTH_CARD + "mean = [1]\n", "a list of 3 numbers"),
    "another key": (DEPTH_CARD + "colour = 1\n", "found colour"),
    "std": (DEPTH_CARD + "std = [0, 1, 1]\n", "other than 0"),
}


@pytest.mark.parametrize(("text", "says"), BAD.values(), ids=BAD)
def test_a_depth_card_that_is_not_whole_is_refused(here, text, says):
    (here / "depth.toml").write_text(text)
    with pytest.raises(RsaDataError, match=says):
        choice.files(card=here / "depth.toml", depth_weights=here / "d.onnx")


def test_a_depth_model_is_named_or_described():
    with pytest.raises(UsageError, match="expected --depth-model NAME, or --card FILE"):
        measure.STAGE.check()
