"""docs/extending.md: its blocks are written to files and used through the command line."""

import json
import os
import re
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from own_models import write_graph
from PIL import Image

from rsa_data.store.tables import WorkDir

PAGE = (Path(__file__).parents[1] / "docs" / "extending.md").read_text("utf-8")
BLOCKS = dict(re.findall(r"<!-- example: ([\w-]+) -->\n```\w+\n(.*?)```", PAGE, re.DOTALL))
MODULES = {name: code for name, code in BLOCKS.items() if name != "pyproject"}
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


@pytest.fixture(scope="session")
def package(tmp_path_factory) -> Path:
    """The package of the page, as pip installs it: its head names the input by its entry point."""
    source, site = tmp_path_factory.mktemp("example"), tmp_path_factory.mktemp("site")
    (source / "pyproject.toml").write_text(BLOCKS["pyproject"])
    for name, code in MODULES.items():
        (source / f"{name}.py").write_text(code.replace('"focal:FOCAL"', '"focal"'))
    options = ["--no-index", "--no-deps", "--no-build-isolation", "--quiet", "--target", site]
    words = [sys.executable, "-m", "pip", "install", *map(str, options), str(source)]
    subprocess.run(words, check=True, timeout=300)
    return site


@pytest.fixture
def installed(folder, package) -> Path:
    """The folder, with the package instead of loose modules."""
    shutil.copytree(package, folder, dirs_exist_ok=True)
    return folder


@pytest.mark.slow
def test_modules_of_ones_own_from_photos_to_metrics(folder):
    shell(SCRIPT, folder)
    work = WorkDir(folder / "work")
    texts = work.table("office", "captions/shares-SHARES").read(0)["text"].to_pylist()
    assert texts[0] == "A photo where wall takes 5 tenths, floor takes 5 tenths"
    tables = work.tables("office")
    assert {"segments/halves-build", "embeddings/images/colours-COLOURS"} <= set(tables)
    assert {"embeddings/shares-SHARES/letters-LETTERS", "depth/floor-build"} <= set(tables)
    place = folder / "work/heads/wide/evaluation/inner-INNER"
    for name in ("md", "txt", "tex"):
        assert "within 10 cm" in (place / f"summary.{name}").read_text()
    assert "↑" not in (place / "summary.tex").read_text()
    measured = set(json.loads((place / "_evaluation.json").read_text())["code"])
    assert measured == {"within:WITHIN", "inner:INNER"}
    assert "no problems" in shell("rsa-data verify", folder, RSA_DATA_CODE="wide:Wide")
    described = json.loads((folder / "work/heads/wide/_table.json").read_text())
    assert set(described["code"]) == {"wide:Wide", "inverse:INVERSE_L1", "focal:FOCAL"}

    # Tables keep names with a hyphen; what they were typed as chooses them, and finds the code.
    code = "office:office,wide:Wide"
    chosen = "--style shares:SHARES --encoder letters:LETTERS --depth-model floor:build"
    train = f"rsa-data train-head --name plain {chosen} --validation 0.34 --epochs 1"
    said = shell(train, folder, RSA_DATA_CODE=code)
    assert "next: RSA_DATA_CODE=office:office,wide:Wide," in said and "letters:LETTERS" in said
    said = shell("rsa-data robustness --head plain", folder, code=None, RSA_DATA_CODE=code)
    assert "RSA_DATA_CODE=letters:LETTERS" in said
    code += ",letters:LETTERS,shares:SHARES"
    shell("rsa-data robustness --head plain", folder, RSA_DATA_CODE=code)
    own = "--segments halves:build --depth-model floor:build"
    predict = f"rsa-data predict photos/room_1/0.jpg {own} --head"
    assert "wall, 50.0%" in shell(f"{predict} plain", folder, RSA_DATA_CODE=code)
    said = shell(f"{predict} wide", folder, code=None, RSA_DATA_CODE=f"{code},focal:FOCAL")
    assert "cannot be used on single photos" in said

    # The source is part of the fingerprint: a changed module is another one.
    (folder / "letters.py").write_text(MODULES["letters"] + "\n# changed\n")
    said = shell(f"{predict} plain --caption a", folder, code=1, RSA_DATA_CODE=code)
    assert "trained with another file code" in said
    (folder / "shares.py").write_text(MODULES["shares"] + "\n# changed\n")
    again = (
        "rsa-data captions --dataset office:office --segments halves:build --style shares:SHARES"
    )
    said = shell(again, folder, code=1)
    assert "--start-over" in said and "sha256" in said

    (folder / "inverse.py").write_text(MODULES["inverse"] + "\n# changed\n")
    (train,) = (line for line in SCRIPT.splitlines() if "train-head" in line)
    said = shell(train, folder, code=1, RSA_DATA_CODE="office:office,wide:Wide")
    assert "code.inverse:INVERSE_L1: the table has" in said and "--start-over" in said

    # What a file names is not imported.
    said = shell("rsa-data evaluate --head wide", folder, code=None, RSA_DATA_CODE="office:office")
    assert "RSA_DATA_CODE=wide:Wide" in said


@pytest.mark.slow
def test_an_installed_package_adds_names(installed):
    folder = installed
    names = re.sub(r"(\w+):(?:office|build|[A-Z]\w+)\b", r"\1", SCRIPT)
    names = re.sub(r"-(SHARES|LETTERS)\b", "", names)
    names = re.sub(r"export RSA_DATA_CODE=.*\n", "", names)
    shell(names, folder)
    work = WorkDir(folder / "work")
    assert {"captions/shares", "embeddings/shares/letters"} <= set(work.tables("office"))
    source = work.table("office", "captions/shares").description().identity
    assert source["code_package"] == "example-parts 1.2" and source["code"] == "shares:SHARES"
    listed = shell("rsa-data list", folder)
    for name in ("office", "halves", "shares", "letters", "colours", "floor", "wide", "inverse",
                 "within10cm", "inner"):  # fmt: skip
        assert re.search(rf"^  {name} .*\(example-parts 1\.2\)$", listed, re.MULTILINE), name

    # The metric is a column, its protocol counts the inner pixels, the head has read fx.
    place = folder / "work/heads/wide/evaluation/inner"
    frame = pd.read_parquet(place / "metrics.parquet").query("status == 'ok'")
    assert frame["within10cm"].between(0, 1).all() and "within 10 cm" in (
        place / "summary.md").read_text()  # fmt: skip
    assert set(frame["n_valid"]) == {(24 - 2 * 2) * (32 - 2 * 3)}
    assert set(json.loads((place / "_evaluation.json").read_text())["code"]) == {
        "within:WITHIN", "inner:INNER",
    }  # fmt: skip
    head = json.loads((folder / "work/heads/wide/head.json").read_text())
    assert [given["encoder"] for given in head["features"]["beside"]] == ["focal"]
    assert head["features"]["dim"] == 27 + 1 and head["options"]["loss"] == "inverse"

    # A work dir in a store of the package's.
    first = "rsa-data captions --dataset office --root photos --segments halves --style shares"
    shell(f"{first} --work sqlite://made.db && rsa-data verify --work sqlite://made.db", folder)
    with closing(sqlite3.connect(folder / "made.db")) as database:
        files = {path for (path,) in database.execute("SELECT path FROM files")}
    there = work.table("office", "captions/shares")
    assert {f"office/captions/shares/{there.receipt(n).file}" for n in there.parts()} <= files

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


def test_a_broken_entry_breaks_nothing_else(installed):
    folder = installed
    (folder / "shares.py").write_text("import no_such_module\n")
    listed = shell("rsa-data list styles", folder)
    assert "no_such_module" in listed and "occupancy" in listed
    captions = "rsa-data captions --dataset office --root photos --segments halves"
    said = shell(f"{captions} --style shares", folder, code=1)
    assert "style 'shares': expected SHARES in the module shares; found ModuleNot" in said
    shell(f"{captions} --style occupancy", folder)


def test_code_that_is_not_there_or_something_else_is_told(folder):
    captions = "rsa-data captions --dataset office:office --root photos --segments halves:build"
    said = shell(f"{captions} --style shraes:SHARES", folder, code=2)
    assert (
        "unknown style 'shraes'" in said
        and f"finds no module shraes; put its folder on PYTHONPATH (now {folder}" in said
    )
    said = shell(f"{captions} --style letters:LETTERS", folder, code=2)
    assert "style 'letters:LETTERS': expected a Wording; found an Encoder" in said
    said = shell("rsa-data status", folder, RSA_DATA_CODE="shares.SHARES,shraes:SHARES")
    assert "expected module:attribute, separated by commas; found 'shares.SHARES'" in said
    assert "shraes:SHARES: Python finds no module shraes" in said


def test_a_name_that_nobody_knows_lists_installed_ones_too(installed):
    said = shell("rsa-data captions --dataset office --style share", installed, code=2)
    assert "Did you mean 'shares'" in said
