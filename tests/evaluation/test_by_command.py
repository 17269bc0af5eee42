"""evaluate, compare and robustness as they are typed: splits, datasets that cannot be measured."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from evaluated import SIZE, images, maps

from rsa_data import depth_errors
from rsa_data.cli.main import cli
from rsa_data.common.errors import UsageError
from rsa_data.store.tables import WorkDir


def call(work: WorkDir, *words: str) -> str:
    words = (*words, "--work", work.store.location)
    result = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def beyond_reach(work: WorkDir, dataset: str, **more) -> None:
    """Test images of which no pixel counts: all of their ground truth is too far."""
    far = np.full((4, SIZE[0] * SIZE[1]), 200.0)
    images(work, dataset, 4, "test", metric=far, **more)


def test_one_dataset_that_cannot_be_measured_leaves_the_others_their_rows(work):
    alone = call(work, "evaluate", "--draws", "0")
    beyond_reach(work, "void")
    said = call(work, "evaluate", "--draws", "0")
    ours = [line for line in alone.splitlines() if line.startswith("nyuv2 ")]
    theirs = [line for line in said.splitlines() if line.startswith("nyuv2 ")]
    assert [line.split() for line in ours if "joint" not in line] == [
        line.split() for line in theirs if "joint" not in line
    ]
    assert "void: nothing could be measured: see error in metrics.parquet." in said
    words = ("compare", "--seeds", "1", "--epochs", "1", "--threads", "1", "--draws", "0")
    said = call(work, *words)
    assert "void: nothing could be measured" in said
    assert [line for line in said.splitlines() if line.startswith("nyuv2 ") and "text" in line]


def test_a_split_for_each_dataset(work):
    images(work, "ddad", 8, "val", builder="ddad")
    images(work, "void", 8, "test")
    # DDAD has no test images: without its own split it is not measured.
    assert "ddad" not in call(work, "evaluate", "--draws", "0")
    said = call(work, "evaluate", "--draws", "0", "--split", "test,ddad=val", "--compare", "paper")
    assert {line.split()[0] for line in said.splitlines() if " linear fit " in line} == {
        "nyuv2",
        "void",
        "ddad",
    }
    assert "paper: ddad: no row taken: number of test images is 8 here, 3950 there" in said
    record = work.store.read("heads/head/evaluation/rsa.test,ddad=val/_evaluation.json")
    assert json.loads(record)["split"] == "test,ddad=val"
    for split, reason in (
        ("test,ddad=", "expected SPLIT or SPLIT,DATASET=SPLIT; found 'test,ddad='"),
        ("test,dad=val", "unknown dataset in --split 'dad'"),
    ):
        with pytest.raises(UsageError, match=reason):
            call(work, "evaluate", "--split", split)


def test_the_releases_rule_for_negative_depth(work):
    """scale * y + shift < 0: the maximum here, the minimum with --beyond near."""
    rng = np.random.default_rng(0)
    y = rng.uniform(-40, 10, (4, SIZE[0] * SIZE[1]))  # as bicubic resizing may leave it
    images(work, "void", 4, "test", relative=y)
    frames = {}
    for beyond in ("far", "near"):
        call(work, "evaluate", "--datasets", "void", "--beyond", beyond, "--draws", "0")
        place = "rsa.void" if beyond == "far" else "rsa.near.void"
        path = work.store.folder / "heads/head/evaluation" / place
        assert ("--beyond near" in (path / "summary.txt").read_text()) == (beyond == "near")
        frames[beyond] = pytest.importorskip("pandas").read_parquet(path / "metrics.parquet")
    for beyond, instead in (("far", 5.0), ("near", 0.2)):
        found = frames[beyond][frames[beyond]["method"] == "head"].to_dict("records")
        assert len(found) == 4
        for (y, gt), row in zip(maps(work, "void", 0), found, strict=True):
            inverse = row["scale"] * y + row["shift"]
            assert (inverse < 0).any()
            pred = np.where(inverse < 0, instead, 1 / inverse)
            expected = depth_errors(gt, pred, min_depth=0.2, max_depth=5.0)
            assert row["rmse"] == pytest.approx(expected["rmse"])
