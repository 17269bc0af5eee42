"""docs/reading.md: each example runs in a folder that holds a work dir, if its package is there."""

import gc
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from evaluated import FAST, images
from flat import train_head

from rsa_data.cli.main import cli
from rsa_data.evaluation.evaluate import evaluate
from rsa_data.store.tables import WorkDir

PAGE = (Path(__file__).parents[1] / "docs" / "reading.md").read_text("utf-8")
EXAMPLES = dict(re.findall(r"<!-- example: (\w+) -->\n```python\n(.*?)```", PAGE, re.DOTALL))
COMMANDS = dict(re.findall(r"<!-- run: (\w+) -->\n```bash\n(.*?)```", PAGE, re.DOTALL))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reading")
    work = WorkDir(folder / "work")
    images(work, "nyuv2", 64, "train")
    images(work, "nyuv2", 16, "test", first_part=1)
    train_head(work, epochs=2, **FAST)
    evaluate(work)
    return folder


def ran(name: str, folder: Path, monkeypatch) -> dict:
    monkeypatch.chdir(folder)
    names: dict = {}
    exec(EXAMPLES[name], names)
    return names


def test_pandas(folder, monkeypatch):
    names = ran("pandas", folder, monkeypatch)
    assert len(names["captions"]) == 160 and len(names["joined"]) == 80
    assert names["joined"]["scene"].notna().all()


def test_features_of_both_ways_are_the_same(folder, monkeypatch):
    by_hand = ran("features", folder, monkeypatch)["features"]
    names = ran("package", folder, monkeypatch)
    np.testing.assert_array_equal(by_hand, names["features"])
    assert names["captions"]["text"][0] == "a 0"


def test_polars(folder, monkeypatch):
    pytest.importorskip("polars")
    assert len(ran("polars", folder, monkeypatch)["longest"]) == 3


def test_duckdb(folder, monkeypatch):
    pytest.importorskip("duckdb")
    worst = ran("duckdb", folder, monkeypatch)["worst"]
    errors = [row[1] for row in worst]
    assert len(worst) == 5 and errors == sorted(errors, reverse=True)
    assert all(len(row[3]) == 32 for row in worst)  # 16 values of float16


@pytest.mark.parametrize(("command", "name"), [("export", "datasets"), ("shards", "webdataset")])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_exports(folder, monkeypatch, command, name):
    pytest.importorskip(name)
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(cli, COMMANDS[command].split()[1:])
    assert done.exit_code == 0, done.output
    names = ran(name, folder, monkeypatch)
    if name == "datasets":
        assert len(names["rows"]) == 128 and len(names["rows"][0]["embedding"]) == 16
    else:
        assert names["text"].startswith("a ") and names["features"].shape == (2, 16)
        del names
        gc.collect()  # webdataset leaves its files to be closed by it


def test_pytorch(folder, monkeypatch):
    batch = ran("pytorch", folder, monkeypatch)["batch"]
    assert batch["feature"].shape == (32, 16) and batch["relative"].shape == (32, 48)
