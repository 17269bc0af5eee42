"""The chain on real data: the released segments, and the 7-Scenes job with real models."""

import tarfile
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pyarrow.compute as pc
import pytest
from click.testing import CliRunner

from rsa_data.cli.main import cli
from rsa_data.store.tables import WorkDir


def call(*words: object) -> str:
    """Runs a command in this process; fails the test when it fails."""
    result = CliRunner().invoke(cli, [str(word) for word in words], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture(scope="module")
def release(shared, tmp_path_factory):
    folder = tmp_path_factory.mktemp("release")
    for name in ("nyu-train", "nyu-test", "kitti-test"):
        with tarfile.open(shared / f"rsa_release/{name}.tar.xz") as archive:
            archive.extractall(folder, filter="data")
    return folder / "text"


def counted(work: WorkDir, dataset: str) -> tuple[int, int, int, int]:
    """(samples, segments, those with a name of several words, captions)."""
    segments = work.table(dataset, "segments/rsa-release")
    labels = [
        pc.list_flatten(segments.read(n, columns=["label"])["label"]) for n in segments.parts()
    ]
    captions = work.table(dataset, "captions/occupancy")
    return (
        sum(segments.receipt(n).ok for n in segments.parts()),
        sum(len(part) for part in labels),
        sum(pc.sum(pc.match_substring(part, " ")).as_py() for part in labels),
        sum(captions.receipt(n).rows for n in captions.parts()),
    )


@pytest.mark.slow
def test_released_segments_of_nyu(release, tmp_path):
    out = call(
        "captions", "--dataset", "nyuv2", "--segments", f"rsa-release:{release}", "--work", tmp_path
    )
    assert counted(WorkDir(tmp_path), "nyuv2") == (24_885, 345_104, 19_247, 5 * 24_885)
    assert out.splitlines()[-1] == f"next: rsa-data embed --dataset nyuv2 --work {tmp_path}"


def test_released_segments_of_kitti(release, tmp_path):
    call(
        "captions", "--dataset", "kitti", "--segments", f"rsa-release:{release}", "--work", tmp_path
    )
    work = WorkDir(tmp_path)
    assert counted(work, "kitti")[:2] == (652, 9_225)
    segments = work.table("kitti", "segments/rsa-release")
    labels = [
        label
        for n in segments.parts()
        for row in segments.read(n)["label"].to_pylist()
        for label in row
    ]
    assert labels.count("traffic light") == 326
    assert "traffic" not in labels


@pytest.mark.slow
def test_seven_scenes_job(shared, tmp_path):
    out = call(
        "run",
        "7scenes",
        "--work",
        tmp_path,
        "--root",
        f"7scenes={shared}/rgbd/7scenes",
        "--set",
        f"detect.segmenter_weights={shared}/models/yolox_nano.onnx",
        "--set",
        f"depth.depth_weights={shared}/models/tu2020_mbv2_blconv7dw_nyu_224.onnx",
    )
    work = WorkDir(tmp_path)
    for table in work.tables("7scenes"):
        parts = work.table("7scenes", table)
        rows = [(parts.receipt(n).ok, parts.receipt(n).failed) for n in parts.parts()]
        assert sum(failed for _, failed in rows) == 0, table
        if table.startswith(("samples", "segments", "depth")):
            assert rows == [(80, 0), (20, 0)]
    assert "block" in out, "a validation that is no scene of its own must be labelled"
    verified = call("verify", "--work", tmp_path)
    assert "no problems" in verified


@pytest.mark.slow
def test_a_few_real_places(shared, tmp_path, monkeypatch):
    """One frame of each of 13 places, arranged by benchmarks/places.py; one epoch, one seed."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
    from places import arrange

    counts = arrange(shared / "rgbd" / "mosaic", tmp_path, frames=1)
    assert counts == {"rooms": 8, "streets": 5}
    # Its file is in mm, though it is outdoors: written again in m/256.
    name = "lingbot_3/depth/0.png"
    given = cv2.imread(f"{shared}/rgbd/mosaic/lingbot_3/0_depth.png", -1) / 1000
    taken = cv2.imread(str(tmp_path / "streets" / name), -1) / 256
    np.testing.assert_allclose(taken, given, atol=0.5 / 256 + 1e-9)
    out = call(
        "run", "places", "--work", tmp_path / "work",
        "--root", f"rooms={tmp_path}/rooms", "--root", f"streets={tmp_path}/streets",
        "--set", f"detect.segmenter_weights={shared}/models/yolox_nano.onnx",
        "--set", f"depth.depth_weights={shared}/models/tu2020_mbv2_blconv7dw_nyu_224.onnx",
        "--set", "compare.epochs=1", "--set", "compare.seeds=1",
    )  # fmt: skip
    # Of 8 and 5 places 3 and 2 are held out: 2 / 2^3 and 2 / 2^2 by the sign test.
    for said in (
        "rooms: 3 images of only 3 scenes",
        "in 25% of cases",
        "streets: 2 images of only 2 scenes",
        "in 50% of cases",
        "it does not show which input is better",
        "list of names",
    ):
        assert said in out
    rows = pd.read_csv(tmp_path / "work/comparisons/places/summary.csv")
    assert set(rows[rows["images"] > 0]["dataset"]) == {"rooms", "streets"}
    inputs = {"text", "objects", "objects without places", "objects, names only"}
    assert inputs | {"text and objects"} <= set(rows["method"]) and not rows["failed"].any()
    assert set(rows["synthetic"]) == {"no"}
