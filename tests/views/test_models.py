"""models, models fetch, models check: with real weights, and against a server on loopback."""

import hashlib
import http.server
import json
import shutil
import threading
from pathlib import Path

import onnx
import pytest
from click.testing import CliRunner
from onnx import TensorProto, helper

from rsa_data.cli.main import cli
from rsa_data.common import cards
from rsa_data.common.errors import RsaDataError, UsageError


def run(*words):
    """A call of `rsa-data models`."""
    return CliRunner().invoke(cli, ["models", *map(str, words)])


@pytest.fixture
def served(tmp_path, monkeypatch):
    """A server on loopback, and the cards' folder with room for cards of files that it serves."""
    files = tmp_path / "served"
    files.mkdir()
    own = tmp_path / "cards"
    shutil.copytree(Path(cards.__file__).parent / "model_cards", own)
    monkeypatch.setattr(cards, "CARDS", own)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def __init__(self, *given, **more):
            super().__init__(*given, directory=str(files), **more)

        def log_message(self, *given):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Quiet)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield files, own, f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()


def depth_graph(path: Path, sign: float) -> None:
    """A depth model of one operator: y is the row, from the top or from the bottom, by the sign."""
    ramp = [sign * row for row in range(32) for _ in range(32)]
    value = helper.make_tensor("ramp", TensorProto.FLOAT, [1, 1, 32, 32], ramp)
    zero = helper.make_tensor("zero", TensorProto.FLOAT, [], [0.0])
    nodes = [
        helper.make_node("ReduceMean", ["image"], ["mean"], keepdims=1, axes=[1]),
        helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
        helper.make_node("Add", ["nothing", "ramp"], ["depth"]),
    ]
    form = [1, 3, 32, 32]
    graph = helper.make_graph(
        nodes,
        "ramp",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, form)],
        [helper.make_tensor_value_info("depth", TensorProto.FLOAT, [1, 1, 32, 32])],
        [value, zero],
    )
    opset = [helper.make_opsetid("", 13)]
    onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=8), path)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_check_downloads_runs_and_tells_right_from_wrong(served, tmp_path, sign):
    files, own, address = served
    depth_graph(files / "m.onnx", sign)
    sha = hashlib.sha256((files / "m.onnx").read_bytes()).hexdigest()
    (own / "midas-v21-small.toml").write_text(
        f'kind = "relative-depth"\nlicence = "MIT"\nurl = "{address}/m.onnx"\nsha256 = "{sha}"\n'
        'resize = "squash"\nwidth = 32\nheight = 32\noutput = "inverse"\n'
    )
    out, table = tmp_path / "o.json", tmp_path / "t.md"
    done = run("check", "midas-v21-small", "--out", out, "--table", table)
    (model,) = json.loads(out.read_text())["models"]
    assert model["sha256"] == sha
    if sign > 0:
        assert done.exit_code == 0 and model["state"] == "ok", done.output
        assert f"| midas-v21-small | relative-depth | yes | {sha[:12]} |" in table.read_text()
    else:  # nearer at the top: colours or channels were swapped, or depth was taken for its inverse
        assert done.exit_code == 1 and model["state"] == "failed"
        assert "ground is nearer at the bottom" in model["reason"]
    assert f"{sha[:12]}" in run().output


def test_fetch_downloads_once_and_refuses_other_bytes(served):
    files, own, address = served
    (files / "h").write_bytes(b"head")
    sha = hashlib.sha256(b"head").hexdigest()
    card = f'kind = "head"\nlicence = "MIT"\ndepth_model = "tu2020"\nurl = "{address}/h"\n'
    (own / "mine.toml").write_text(card + f'sha256 = "{sha}"\n')
    (own / "other.toml").write_text(card + f'sha256 = "{"0" * 64}"\n')
    assert run("fetch", "mine").exit_code == 0
    (files / "h").unlink()
    assert run("fetch", "mine").exit_code == 0
    (files / "h").write_bytes(b"head")
    done = run("fetch", "mine", "other")
    assert isinstance(done.exception, RsaDataError) and "1 of 2 models" in str(done.exception)
    assert "expected sha256 0000" in done.stderr
    assert isinstance(run("fetch", "mien").exception, UsageError)


def test_real_models_pass(shared, tmp_path):
    models, heads = shared / "models", shared / "rsa_heads"
    files = {
        "yolox-nano": models / "yolox_nano.onnx",
        "deeplab-v3-voc": models / "deeplab_v3_1_default_1.onnx",
        "tu2020": models / "tu2020_mbv2_blconv7dw_nyu_224.onnx",
        "rsa-depth-anything": heads / "da_lanscale.pt",
        "rsa-midas": heads / "midas_lanscale.pt",
    }
    words = [word for name, path in files.items() for word in ("--weights", f"{name}={path}")]
    done = run("check", *words, "--out", tmp_path / "o.json")
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "o.json").read_text())["models"]
    assert {m["name"]: m["state"] for m in found} == dict.fromkeys(files, "ok")
    # The released heads are the files that their cards name.
    for name in ("rsa-depth-anything", "rsa-midas"):
        card = cards.read_card(cards.card_path(name))
        assert card.sha256 == next(m["sha256"] for m in found if m["name"] == name)
