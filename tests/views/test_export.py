"""The export, from a small work dir made through the real stages."""

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from click.testing import CliRunner
from tiny_encoders import captions, samples

from rsa_data import registry
from rsa_data.cli.main import cli
from rsa_data.common.errors import UsageError
from rsa_data.embeddings.embed import build
from rsa_data.store import schemas
from rsa_data.store.tables import Description, Made, WorkDir
from rsa_data.views.export import export

TEXTS = ["An image.", "An image with a bed.", "An image.", "a", "An image.", "b"]


@pytest.fixture
def work(tmp_path, monkeypatch) -> WorkDir:
    """A work dir with one part of two images, three captions each, and their features."""
    monkeypatch.setitem(registry.ENCODERS, "tiny", "tiny_encoders:TINY")
    work = WorkDir(tmp_path / "work")
    part = captions(TEXTS)
    made = {
        "samples": ("samples", samples(["0.png", "1.png"])),
        "captions/occupancy": ("captions", part),
        "embeddings/occupancy/tiny": (
            "embeddings",
            build(encoder="tiny", runtime="torch", store="float16")(part),
        ),
    }
    for name, (schema, table) in made.items():
        description = {"stage": "x", "schema": schema, "options": {"normalize": False}}
        work.table("nyuv2", name).bind(Description(**description, files={"weights": "ab12"}))
        receipt = {"ok": 2, "failed": 0, "skipped": 0, "split": "train"}
        work.table("nyuv2", name).commit(7, table, Made(**receipt))
    return work


def test_rows_are_captions_with_their_features_as_lists(work, tmp_path):
    assert export(work, out=tmp_path / "out") == {"nyuv2/train": 6}
    rows = pq.read_table(tmp_path / "out" / "nyuv2" / "train-00007.parquet")
    expected = schemas.embedding_array(build(encoder="tiny", runtime="torch")(captions(TEXTS)))
    order = [0, 1, 0, 2, 0, 3]
    assert rows["text"].to_pylist() == TEXTS
    assert rows["image"].to_pylist() == ["0.png"] * 3 + ["1.png"] * 3
    np.testing.assert_array_equal(np.stack(rows["embedding"].to_numpy()), expected[order])


def test_the_card_names_files_counts_encoder_and_terms(work, tmp_path):
    export(work, out=tmp_path / "out")
    card = (tmp_path / "out" / "README.md").read_text()
    _, head, body = card.split("---\n", 2)
    assert yaml.safe_load(head)["configs"] == [
        {
            "config_name": "nyuv2",
            "data_files": [{"split": "train", "path": "nyuv2/train-*.parquet"}],
        }
    ]
    assert "| nyuv2 | train | 6 |" in body
    assert "academic use" in body
    assert "| nyuv2 | occupancy | tiny | normalize=False | weights: ab12 |" in body


def test_datasets_opens_it(work, tmp_path):
    datasets = pytest.importorskip("datasets")
    export(work, out=tmp_path / "out")
    rows = datasets.load_dataset(str(tmp_path / "out"), "nyuv2", split="train")
    assert rows[1]["text"] == TEXTS[1]
    assert len(rows[1]["embedding"]) == 32


def test_nothing_is_overwritten_and_the_command_says_where(work, tmp_path):
    result = CliRunner().invoke(
        cli, ["export", "--work", str(tmp_path / "work"), "--out", str(tmp_path / "out")]
    )
    assert result.exit_code == 0, result.output
    assert result.output.startswith("nyuv2/train: 6 rows\n")
    with pytest.raises(UsageError, match="not there yet"):
        export(work, out=tmp_path / "out")
