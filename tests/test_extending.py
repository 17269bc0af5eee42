"""docs/extending.md: its blocks are written to files and used through the command line."""

import configparser
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
from own_models import write_graph
from PIL import Image

from rsa_data.heads.inputs.kinds import Feed
from rsa_data.store.tables import WorkDir

PAGE = (Path(__file__).parents[1] / "docs" / "extending.md").read_text("utf-8")
BLOCKS = dict(re.findall(r"<!-- example: ([\w-]+) -->\n```\w+\n(.*?)```", PAGE, re.DOTALL))
MODULES = {name: code for name, code in BLOCKS.items() if name != "entry-points"}
SCRIPT = re.search(r"<!-- run: extending -->\n```bash\n(.*?)```", PAGE, re.DOTALL)[1]


@pytest.fixture
def folder(tmp_path) -> Path:
    """A folder with the modules of the page and photos of three rooms."""
    for name, code in MODULES.items():
        (tmp_path / f"{name}.py").write_text(code)
    rng = np.random.default_rng(0)
    for room in (1, 2, 3, 9):
        place = tmp_path / "photos" / f"room_{room}"
        place.mkdir(parents=True)
        for k in range(3):
            pixels = rng.integers(0, 256, (24, 32, 3), np.uint8)
            Image.fromarray(pixels).save(place / f"{k}.jpg")
            depth = np.repeat(np.linspace(4000, 1000 + 100 * room, 24)[:, None], 32, 1)
            Image.fromarray(depth.astype(np.uint16)).save(place / f"{k}.png")
    return tmp_path


def shell(script: str, folder: Path, code: int | None = 0, **variables: str) -> str:
    bins = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    root = str(Path(__file__).parents[1])
    script = script.replace("PYTHONPATH=$PWD", f"PYTHONPATH=$PWD:{root}")
    script = script.replace("rsa-data ", f"{sys.executable} -m rsa_data ")
    environment = {**os.environ, "PATH": bins, "PYTHONPATH": f"{folder}:{root}", **variables}
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script],
        cwd=folder, env=environment, capture_output=True, text=True, timeout=500,
    )  # fmt: skip
    assert done.returncode == code or (code is None and done.returncode), done.stdout + done.stderr
    return done.stdout + done.stderr


def install(folder: Path) -> None:
    """Metadata as pip writes it, with the page's entry points."""
    info = folder / "example_parts-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: example-parts\nVersion: 1.2\n")
    points = configparser.ConfigParser()
    points.read_dict(tomllib.loads(BLOCKS["entry-points"])["project"]["entry-points"])
    with (info / "entry_points.txt").open("w") as file:
        points.write(file)


@pytest.mark.slow
def test_modules_of_ones_own_from_photos_to_metrics(folder):
    shell(SCRIPT, folder)
    work = WorkDir(folder / "work")
    texts = work.table("office", "captions/shares-SHARES").read(0)["text"].to_pylist()
    assert texts[0] == "A photo where wall takes 5 tenths, floor takes 5 tenths"
    tables = work.tables("office")
    assert {"segments/halves-build", "embeddings/images/colours-COLOURS"} <= set(tables)
    assert {"embeddings/shares-SHARES/letters-LETTERS", "depth/floor-build"} <= set(tables)
    assert (folder / "work/heads/wide/evaluation/rsa/summary.md").is_file()

    # The source is part of the fingerprint: a changed module is another one.
    (folder / "shares.py").write_text(MODULES["shares"] + "\n# changed\n")
    again = (
        "rsa-data captions --dataset office:office --segments halves:build --style shares:SHARES"
    )
    said = shell(again, folder, code=1)
    assert "--start-over" in said and "sha256" in said

    # What a file names is not imported.
    said = shell("rsa-data evaluate --head wide", folder, code=None, RSA_DATA_CODE="office:office")
    assert "RSA_DATA_CODE=wide:Wide" in said


@pytest.mark.slow
def test_an_installed_package_adds_names(folder):
    install(folder)
    names = re.sub(r"(\w+):(?:office|build|[A-Z]+|Wide)\b", r"\1", SCRIPT)
    names = re.sub(r"-(SHARES|LETTERS)\b", "", names)
    names = re.sub(r"export RSA_DATA_CODE=.*\n", "", names)
    shell(names, folder)
    work = WorkDir(folder / "work")
    assert {"captions/shares", "embeddings/shares/letters"} <= set(work.tables("office"))
    source = work.table("office", "captions/shares").description().identity
    assert source["code_package"] == "example-parts 1.2" and source["code"] == "shares:SHARES"
    listed = shell("rsa-data list", folder)
    for name in ("office", "halves", "shares", "letters", "colours", "floor", "wide"):
        assert re.search(rf"^  {name} .*\(example-parts 1\.2\)$", listed, re.MULTILINE), name

    # A card may name the installed decoder.
    rows = np.array([[[1, 0.9, 0.25, 0, 0.75, 1], [0, 0.1, 0, 0, 1, 1]]], np.float32)
    write_graph(
        folder / "m.onnx",
        [
            ("ReduceMin", ["x"], ["least"], {"keepdims": 0}),
            ("Mul", ["least", "zero"], ["nothing"]),
            ("Add", ["rows", "nothing"], ["found"]),
        ],
        [("x", [1, 3, 8, 8])],
        [("found", [1, 2, 6])],
        [("zero", np.float32(0)), ("rows", rows)],
    )
    (folder / "card.toml").write_text(
        'kind = "segments"\nlicence = "mine"\n[input]\nname = "x"\nresize = "stretch"\n'
        'size = [8, 8]\n[output]\nboxes = "found"\n[decoder]\nfamily = "corners"\n'
        'score_threshold = 0.5\n[classes]\nnames = ["bed", "chair"]\n'
    )
    card = "--segments mine --segmenter-weights m.onnx --card card.toml"
    shell(f"rsa-data detect --dataset office --root photos {card}", folder)
    row = work.table("office", "segments/mine").read(0).slice(0, 1).to_pylist()[0]
    assert row["label"] == ["chair"] and row["box"] == [[8, 0, 24, 24]]


def test_a_broken_entry_breaks_nothing_else(folder):
    install(folder)
    (folder / "shares.py").write_text("import no_such_module\n")
    listed = shell("rsa-data list styles", folder)
    assert "no_such_module" in listed and "occupancy" in listed
    captions = "rsa-data captions --dataset office --root photos --segments halves"
    said = shell(f"{captions} --style shares", folder, code=1)
    assert "style 'shares': expected SHARES in the module shares; found ModuleNot" in said
    shell(f"{captions} --style occupancy", folder)


def test_a_name_that_nobody_knows_lists_installed_ones_too(folder):
    install(folder)
    said = shell("rsa-data captions --dataset office --style share", folder, code=2)
    assert "Did you mean 'shares'" in said


def test_examples_of_a_loss_a_metric_and_an_input_compute_what_they_say(tmp_path):
    torch = pytest.importorskip("torch")
    made = {}
    for name in ("inverse-l1", "within10cm", "focal"):
        exec(BLOCKS[name], made)
    predicted, true = torch.tensor([[1.0, 2.0]]), torch.tensor([[2.0, 4.0]])
    assert made["INVERSE_L1"].of(predicted, true).tolist() == [0.375]
    depth = np.array([1.0, 2.0, 3.0, 4.0])
    gone = np.array([0.05, 0.5, -0.05, 0.0])
    assert made["WITHIN"].of(SimpleNamespace(difference=gone, gt=depth)) == 0.75
    samples = pa.table({"fx": [500.0, None, 700.0]})
    work = SimpleNamespace(
        table=lambda dataset, name: SimpleNamespace(read=lambda n, columns: samples.select(columns))
    )
    feed = Feed("focal", made["FOCAL"].table)
    block = made["FOCAL"].read(work, "x", feed, 0, None)
    assert block.there.tolist() == [True, False, True] and block.width == 1
    rows = block.rows(np.array([0, 2]), np.zeros(2))
    assert rows.tolist() == [[500.0], [700.0]] and rows.dtype == np.float32
