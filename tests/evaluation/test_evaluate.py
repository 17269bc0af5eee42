"""evaluate: every image and method accounted for, and the numbers those of the definitions."""

import io
import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from evaluated import FAST, images, maps
from flat import evaluate, train_head

from rsa_data import ScaleHead, depth_errors
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.evaluation import protocols
from rsa_data.evaluation.inputs import TestPart
from rsa_data.evaluation.known_metrics import metrics
from rsa_data.evaluation.methods import scaled
from rsa_data.evaluation.protocols import Rules
from rsa_data.evaluation.rows import measure
from rsa_data.evaluation.summary import interval
from rsa_data.store.tables import WorkDir


def test_every_row_equals_depth_errors_of_its_scale_and_shift(work):
    found = evaluate(work)
    frame = found.table.to_pandas()
    assert list(frame["method"].unique()) == [
        "head",
        "constant",
        "constant (L1)",
        "median",
        "linear fit",
        "linear fit in depth",
    ]
    assert set(frame["status"]) == {"ok"}
    assert set(frame["n_valid"]) == {47}
    for _, rows in frame.groupby("method", sort=False):
        assert len(rows) == 16
        for (y, gt), row in zip(maps(work, "nyuv2", 1), rows.to_dict("records"), strict=True):
            pred = 1 / (row["scale"] * y + row["shift"])
            expected = depth_errors(gt, pred, min_depth=1e-3, max_depth=10.0)
            assert {m: row[m] for m in metrics()} == pytest.approx(expected, abs=1e-9)

    means = frame.groupby("method")[list(metrics())].mean()
    for row in found.rows:
        assert row.mean == pytest.approx(means.loc[row.method].to_dict())
        assert row.low["abs_rel"] <= row.mean["abs_rel"] <= row.high["abs_rel"]
    error = means["abs_rel"]
    assert error["linear fit"] < error["head"] < 0.9 * error["constant"]


def test_it_is_written_and_the_same_again(work):
    first = evaluate(work)
    read = work.store.read
    files = {n: read(f"{first.folder}/{n}") for n in work.store.list(first.folder)}
    summaries = {f"summary.{e}" for e in ("md", "tex", "csv", "txt")}
    assert set(files) == {"metrics.parquet", "by_description.csv", "_evaluation.json", *summaries}
    again = evaluate(work)
    assert files == {n: read(f"{again.folder}/{n}") for n in files}
    assert pq.read_table(io.BytesIO(files["metrics.parquet"])).equals(first.table)
    csv = pd.read_csv(io.BytesIO(files["summary.csv"]))
    by = pd.read_csv(io.BytesIO(files["by_description.csv"]))
    objects = by[(by["by"] == "objects") & (by["method"] == "head")]
    assert objects[["value", "images"]].values.tolist() == [["1 to 2", 16]]
    assert objects["abs_rel"].tolist() == pytest.approx([first.rows[0].mean["abs_rel"]])
    assert csv["abs_rel"].tolist() == [row.mean["abs_rel"] for row in first.rows]


def test_zero_shot_has_a_joint_constant_and_says_so(work):
    images(work, "void", 8, "test")
    found = evaluate(work)
    methods = [row.method for row in found.rows if row.dataset == "void"]
    assert methods == ["head", "joint constant", "median", "linear fit", "linear fit in depth"]
    assert "Zero-shot (the head was not trained on it): void." in found.summary


def test_images_that_cannot_be_measured_are_accounted_for(tmp_path):
    work = WorkDir(tmp_path)
    images(work, "nyuv2", 64, "train")
    images(work, "nyuv2", 16, "test", first_part=1, failed=(3,))
    train_head(work, epochs=1, **FAST)
    frame = evaluate(work).table.to_pandas()
    bad = frame[frame["sample_id"] == "nyuv2/test/000003"]
    assert set(bad["status"]) == {"failed"}
    assert set(bad["error"]) == {"depth: no valid pixel"}
    assert len(frame) == 6 * 16
    assert "nyuv2: 1 images failed: see error" in evaluate(work).summary


def test_depth_at_the_ends_of_the_range_does_not_count(tmp_path):
    """Strictly between, as BTS's eval.py: logical_and(gt > min_depth_eval, gt < max_depth_eval)."""
    gt = np.full((1, 48), 2.0)
    gt[0, :3] = np.float16(1e-3), 10, np.nextafter(np.float16(10), np.float16(0))
    work = WorkDir(tmp_path)
    images(work, "nyuv2", 1, "test", metric=gt)
    part = TestPart(work, "nyuv2", 0, "depth/files")
    ((_, image),) = part.images(Rules(protocols.whole, float(np.float16(1e-3)), 10.0))
    assert image.valid.ravel().tolist() == [False, False, *[True] * 46]


def test_monodepth2_scales_by_the_median(work, monkeypatch):
    # The crop of NYU is for frames of 640x480 px: let the small ones be a dataset of no crop.
    monkeypatch.delitem(protocols.MONODEPTH2.rules, "nyuv2")
    frame = evaluate(work, protocol="monodepth2").table.to_pandas()
    head = frame[frame["method"] == "head"].to_dict("records")
    for (y, gt), row in zip(maps(work, "nyuv2", 1), head, strict=True):
        pred = 1 / (row["scale"] * y + row["shift"])
        valid = gt > 0
        pred *= np.median(gt[valid]) / np.median(pred[valid])
        expected = depth_errors(gt, pred, min_depth=1e-3, max_depth=10.0)
        assert row["abs_rel"] == pytest.approx(expected["abs_rel"])


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({"head": "hat"}, RsaDataError, "expected a head"),
        ({"protocol": "rso"}, UsageError, "Did you mean 'rsa'"),
        ({"datasets": ("nyu",)}, UsageError, "Did you mean 'nyuv2'"),
        ({"split": "val"}, RsaDataError, "no dataset there has the split 'val'"),
        (
            {"split": "val", "datasets": ("nyuv2",)},
            RsaDataError,
            "expected the split 'val'; found test, train",
        ),
    ],
    ids=["head", "protocol", "dataset", "split", "split of a dataset"],
)
def test_wrong_calls(work, options, error, says):
    with pytest.raises(error, match=says):
        evaluate(work, **options)


def test_tables_that_are_not_the_heads_are_refused(work):
    other = {"encoder": "minilm", "store": "float16", "normalize": True, "threads": 2}
    images(work, "void", 8, "test", encoder=other)
    with pytest.raises(RsaDataError, match=r"head and embeddings.*normalize"):
        evaluate(work)


@pytest.mark.parametrize("normalize", [False, True])
def test_an_imported_head_is_held_to_what_is_known_of_it(work, normalize):
    head = ScaleHead.load(f"{work.store.location}/heads/head")
    about = json.loads(json.dumps(head.description))
    del about["datasets"]
    about["features"] |= {"style": None, "files": None, "stage_version": None}
    about["features"]["options"] = {"encoder": "minilm", "normalize": normalize}
    unknown = dict.fromkeys(("model", "options", "files", "stage_version"))
    about |= {"depth_model": unknown | {"geometry": {}}, "imported": {"file": "x.pt"}}
    ScaleHead(head.network, about, head.mean, head.factor).save(work.store, "heads/theirs")
    if normalize:
        with pytest.raises(RsaDataError, match="options"):
            evaluate(work, head="theirs")
        return
    found = evaluate(work, head="theirs")
    rows = {row.method: row.mean for row in found.rows}
    own = {row.method: row.mean for row in evaluate(work).rows}
    assert rows == own
    assert "The head was imported" in found.summary and "Zero-shot" not in found.summary


def test_one_scene_gives_no_interval(work):
    images(work, "void", 8, "test", scenes=["one"] * 8)
    found = evaluate(work)
    assert {row.low == {} for row in found.rows if row.dataset == "void"} == {True}
    assert "void: one scene only" in found.summary


def test_the_interval_is_that_of_a_loop_over_draws():
    rng = np.random.default_rng(0)
    scenes = np.array([f"s{i // 5}" for i in range(60)])
    values = rng.normal(size=(60, 2)) + np.repeat(rng.normal(size=(12, 2)), 5, axis=0)
    low, high = interval(values, scenes, draws=4000)
    names = np.unique(scenes)
    means = []
    for _ in range(4000):
        rows = np.concatenate([np.flatnonzero(scenes == s) for s in rng.choice(names, 12)])
        means.append(values[rows].mean(0))
    expected = np.quantile(means, [0.025, 0.975], axis=0)
    np.testing.assert_allclose([low, high], expected, atol=0.04)
    narrow = interval(values, np.arange(60).astype(str))
    assert (high - low > 1.5 * (narrow[1] - narrow[0])).all()


def test_what_is_behind_the_camera_is_near_or_far_as_asked(work):
    """scale * y + shift < 0: as far as the protocol reaches, or, as released, as near."""
    part = TestPart(work, "nyuv2", 1, "depth/files")
    y, gt = next(maps(work, "nyuv2", 1))

    def method(part):
        return lambda image: scaled(image, -0.1, 0.45)

    for beyond, there in (("far", 10.0), ("near", 1e-3)):
        rules = Rules(protocols.whole, 1e-3, 10.0, beyond=beyond)
        row = measure([part], {"m": method}, rules).to_pylist()[0]
        inverse = -0.1 * y + 0.45
        with np.errstate(divide="ignore"):
            pred = np.where(inverse < 0, there, 1 / inverse)
        assert ((gt > 0) & (inverse < 0)).sum() > 5 and ((inverse > 0) & (inverse < 1)).sum() > 5
        expected = depth_errors(gt, pred, min_depth=1e-3, max_depth=10.0)
        assert {m: row[m] for m in metrics()} == pytest.approx(expected)


def test_an_image_that_stands_in_two_parts_is_refused(work):
    images(work, "nyuv2", 4, "test", first_part=2)
    said = "each sample once; found nyuv2/test/000000 in part 1 and in part 2, and 3 more"
    with pytest.raises(RsaDataError, match=said):
        evaluate(work)
