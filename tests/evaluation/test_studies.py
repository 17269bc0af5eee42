"""External predictions, the paper's rows, hard images, error bars, formats, plots."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import cv2
import numpy as np
import pandas as pd
import pytest
from evaluated import SIZE, images, maps
from flat import evaluate

from rsa_data import depth_errors
from rsa_data.common.errors import UsageError
from rsa_data.evaluation import breakdown, formats, paper, plots, spread
from rsa_data.evaluation.contenders import plans
from rsa_data.evaluation.inputs import TestPart
from rsa_data.evaluation.known_metrics import metrics as known
from rsa_data.evaluation.metrics_table import to_table
from rsa_data.evaluation.scenes import one_description
from rsa_data.evaluation.setting import rules_of
from rsa_data.evaluation.summary import Row, no_better, summarise
from rsa_data.heads.belong import Source
from rsa_data.heads.inputs import kinds
from rsa_data.store import schemas
from rsa_data.store.tables import Description, Made, WorkDir

SOURCE = Source("void", "depth/files", (kinds.feed("embeddings/occupancy/minilm"),))


def test_another_models_depth_under_the_same_protocol(work, tmp_path):
    (tmp_path / "other" / "nyuv2" / "test").mkdir(parents=True)
    for i, (_, gt) in enumerate(maps(work, "nyuv2", 1)):
        if i == 1:
            values = (700 * gt).astype(np.uint16)
            cv2.imwrite(str(tmp_path / f"other/nyuv2/test/{i:06d}.png"), values)
        elif i != 2:
            np.save(tmp_path / f"other/nyuv2/test/{i:06d}.npy", 0.9 * gt)
    result = evaluate(work, external=(f"Other={tmp_path}/other",))
    assert "its mean leaves out: Other 1;" in result.summary
    found = result.table.to_pandas()
    rows = found[found["method"] == "Other"].to_dict("records")
    assert [r["status"] for r in rows] == ["ok", "ok", "failed", *["ok"] * 13]
    assert rows[2]["error"] == (
        "test/000002: expected a map in test/000002.npy or .png; found neither"
    )
    assert rows[0]["abs_rel"] == pytest.approx(0.1)
    assert rows[1]["abs_rel"] == pytest.approx(0.3, abs=1e-3)
    assert rows[0]["scale"] is None or np.isnan(rows[0]["scale"])


def test_a_prediction_of_another_size_is_resized(work, tmp_path):
    (tmp_path / "test").mkdir()
    small = np.random.default_rng(0).uniform(1, 5, (3, 4)).astype(np.float32)
    np.save(tmp_path / "test" / "000000.npy", small)
    found = evaluate(work, external=(f"Other={tmp_path}",)).table.to_pandas()
    row = found[found["method"] == "Other"].iloc[0]
    _, gt = next(maps(work, "nyuv2", 1))
    pred = cv2.resize(small, SIZE[::-1], interpolation=cv2.INTER_LINEAR)
    assert row["rmse"] == pytest.approx(
        depth_errors(gt, pred, min_depth=1e-3, max_depth=10)["rmse"]
    )


@pytest.mark.parametrize("given", ["Other", "=x", "Other=/no/such/folder"])
def test_a_wrong_external_is_refused(work, given):
    with pytest.raises(UsageError, match="--external"):
        evaluate(work, external=(given,))


SAME = {
    "split": "test",
    "protocol": "rsa",
    "images": 654,
    "model": "depth-anything-small",
    "options": {"geometry": "560x434", "crop": "none"},
}


def test_the_papers_rows_where_all_is_the_same():
    rows, notes = paper.paper_rows("rooms", "nyuv2", **SAME)
    found = {row.method: row.mean for row in rows}
    six = {
        "delta1": 0.776,
        "delta2": 0.974,
        "delta3": 0.996,
        "abs_rel": 0.148,
        "log10": 0.065,
        "rmse": 0.498,
    }
    assert found["paper: RSA (N+K)"] == six
    assert found["paper: RSA, counts (User-friendly-2) (N+K)"]["abs_rel"] == 0.150
    assert found["paper: ZoeDepth"] == {"delta1": 0.951, "abs_rel": 0.077, "rmse": 0.282}
    assert len(found) == 12
    assert {row.dataset for row in rows} == {"rooms"}
    assert [note for note in notes if "DPT" in note or "MiDaS" in note] == notes


@pytest.mark.parametrize(
    ("kind", "change", "why"),
    [
        ("nyuv2", {"protocol": "bts"}, "protocol is bts here, rsa there"),
        ("nyuv2", {"split": "val"}, "split is val here"),
        ("nyuv2", {"images": 500}, "number of test images is 500 here, 654 there"),
        ("folder", {}, "the paper reports nothing on folder"),
        ("sun3d", {}, "zero-shot rows on it, whose numbers are not known here"),
        ("ddad", {"images": 3950}, "split is test here, val there"),
    ],
)
def test_no_row_of_the_paper_when_conditions_differ(kind, change, why):
    rows, notes = paper.paper_rows("mine", kind, **SAME | change)
    assert rows == []
    assert len(notes) == 1 and why in notes[0]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"model": "depth-anything-v2-small"}, "y was made by depth-anything-v2-small here"),
        ({"options": {"geometry": None}}, "geometry of y is the model card's here, 560x434 there"),
        ({"options": {"geometry": "560x434", "crop": "kb"}}, "crop of y is kb here, none there"),
    ],
)
def test_another_backbone_leaves_only_models_that_need_none(change, why):
    rows, notes = paper.paper_rows("nyuv2", "nyuv2", **SAME | change)
    assert [row.method for row in rows] == ["paper: ZeroDepth", "paper: ZoeDepth"]
    assert any(why in note for note in notes)


def test_the_papers_rows_of_every_backbone_on_kitti():
    how = SAME | {"images": 652, "options": {"geometry": "1204x350", "crop": "kb"}}
    depth_anything = {r.method: r.mean for r in paper.paper_rows("kitti", "kitti", **how)[0]}
    llava = depth_anything["paper: LLaVA-1.6 vision encoder (N+K)"]
    assert list(llava) == ["delta1", "delta2", "delta3", "abs_rel", "rmse_log", "rmse"]
    assert list(llava.values()) == [0.685, 0.930, 0.978, 0.183, 0.215, 4.878]
    errors = {}
    for model, size in (("dpt-hybrid-finetuned", "1216x352"), ("midas-swin2-large-384", "384x384")):
        how |= {"model": model, "options": {"geometry": size, "crop": "kb"}}
        rows = {row.method: row.mean for row in paper.paper_rows("kitti", "kitti", **how)[0]}
        errors[model] = [
            rows[f"paper: {method} (N+K)"]["abs_rel"]
            for method in (
                "detector features",
                "RSA, classes (User-friendly-1)",
                "RSA, counts (User-friendly-2)",
                "RSA",
            )
        ]
    assert errors == {
        "dpt-hybrid-finetuned": [0.108, 0.065, 0.066, 0.060],
        "midas-swin2-large-384": [0.168, 0.163, 0.162, 0.160],
    }


def test_the_papers_rows_of_ddad_are_of_its_validation_split():
    how = SAME | {"split": "val", "images": 3950}
    rows, notes = paper.paper_rows("ddad", "ddad", **how)
    assert rows == []  # at which size y was made there is not known
    assert [note for note in notes if "the geometry that its y was made at" in note]


def test_evaluate_compares_with_the_paper_and_says_why_not(work):
    found = evaluate(work, compare="paper")
    assert "number of test images is 16 here, 654 there" in found.summary
    with pytest.raises(UsageError, match="--compare"):
        evaluate(work, compare="papers")


def test_hard_images_are_the_poorly_described(work):
    about = pd.DataFrame(
        {
            "sample_id": [f"s{i}" for i in range(8)],
            "n_objects": [0, 1, 5, 5, 5, 5, 5, 5],
            "n_kept": [0, 1, 5, 5, 5, 5, 5, 5],
            "area": [0, 0.9, 0.1, 0.9, 0.9, 0.9, 0.9, 0.9],
            "area_kept": [0, 0.9, 0.1, 0.9, 0.9, 0.9, 0.9, 0.9],
        }
    )
    metrics = pd.DataFrame(
        {
            "sample_id": about["sample_id"],
            "method": "head",
            "status": ["ok"] * 7 + ["failed"],
            "abs_rel": [0.8, 0.6, 0.4, 0.1, 0.1, 0.1, 0.1, np.nan],
        }
    )
    found = breakdown.by_group(metrics, about)
    assert found.loc["head"].to_dict() == pytest.approx(
        {"few objects (2)": 0.7, "little covered (2)": 0.6, "neither (5)": 0.1}
    )


def test_the_spread_is_that_of_the_variants(work):
    """A head that reads scale off the feature: the spread follows the variants' features."""
    images(work, "void", 8, "test", texts=[["a 0", "a 1", "a 2"]] * 8)
    part = TestPart(work, "void", 0, "depth/files")

    def head(features):
        return np.zeros(len(features)), 1.0 / np.exp(features @ np.arange(16))

    rules = rules_of(work, "void", "rsa")
    found = spread.spread([part], head, SOURCE, rules, (1, 2))
    # Variants 1 and 2 give depths of e and, beyond the 5 m of VOID, 5.
    assert found.bar == pytest.approx(np.std([1, np.log(5)], ddof=1))
    truth = []
    for y, gt in maps(work, "void", 0):
        valid = (gt > 0.2) & (gt < 5)
        y, gt = y[valid], gt[valid]
        near = np.argsort(np.abs(y - np.median(y)), kind="stable")[: max(1, len(y) // 10)]
        truth.append(np.log(1 / np.median(gt[near])))
    assert found.error == pytest.approx(np.array(truth))


def test_the_truth_of_an_image_with_few_pixels_is_one_pixel(work):
    depth = np.zeros((4, 48))
    depth[:, :3] = 1, 2, 4
    images(work, "void", 4, "test", metric=depth, texts=[["a 0", "a 1", "a 2"]] * 4)
    part = TestPart(work, "void", 0, "depth/files")

    def head(features):
        return np.zeros(len(features)), np.full(len(features), 0.5)

    found = spread.spread([part], head, SOURCE, rules_of(work, "void", "rsa"), (1, 2))
    middle = [gt[0, np.argsort(y[0, :3])[1]] for y, gt in maps(work, "void", 0)]
    assert found.error == pytest.approx(np.log(2 / np.array(middle)))


def test_calibration_of_bars_that_tell_the_truth():
    rng = np.random.default_rng(0)
    bar = rng.uniform(0.05, 0.5, 20_000)
    found = spread.Spread([""] * len(bar), bar, rng.normal(0, bar))
    rows = spread.calibration(found)
    assert [row["images"] for row in rows] == [4000] * 5
    for row in rows:
        assert row["error"] == pytest.approx(row["bar"], rel=0.1)
    assert spread.inflation(found) == pytest.approx(1, abs=0.03)
    assert spread.rank_correlation(found) > 0.3
    same = spread.Spread(["a", "b"], np.zeros(2), np.ones(2))
    assert (spread.inflation(same), spread.rank_correlation(same)) == (np.inf, 0.0)


def test_one_description_a_scene(work):
    part = TestPart(work, "nyuv2", 1, "depth/files")
    names = ("embeddings/occupancy/minilm", "captions/occupancy")
    see = one_description([part], replace(SOURCE, dataset="nyuv2"))
    features, there = part.features(*names)
    shared = see(features, there, part=1)
    assert np.array_equal(shared, np.repeat(features[::4], 4, axis=0))
    images(work, "void", 4, "test", scenes=["a", "b", "c", "d"])
    assert one_description([TestPart(work, "void", 0, "depth/files")], SOURCE) is None


def test_plans_of_a_comparison():
    both, text = ("a", "b"), {"style": "occupancy", "encoder": "minilm"}
    fused = {"style": "occupancy", "encoder": "minilm+clip", "head": "fusion"}
    shared = {
        "text": [("occupancy", "minilm")],
        "image": [("images", "clip")],
        "proposals": [("proposals", "yolox")],
    }
    found = plans(["a", "b"], shared, ("few=counts/minilm/mlp3",), ("b+a",))
    objects = {"style": "proposals", "encoder": "yolox", "head": "proposals"}
    assert [(p.label, p.datasets, p.options) for p in found] == [
        ("text", both, text),
        ("image (clip)", both, {"style": "images", "encoder": "clip"}),
        ("text and image (clip)", both, fused),
        ("detector features (yolox)", both, objects),
        ("few", both, {"style": "counts", "encoder": "minilm", "head": "mlp3"}),
        ("captions shuffled", both, text | {"control": "shuffled"}),
        ("dataset name only", both, text | {"control": "dataset"}),
        ("text, a alone", ("a",), text),
        ("text, b alone", ("b",), text),
        ("text, b and a", ("b", "a"), text),
    ]
    with pytest.raises(UsageError, match="LABEL=STYLE/ENCODER"):
        plans(["a"], shared, ("image",))
    with pytest.raises(UsageError, match="dataset in --subsets 'c'"):
        plans(["a"], shared, (), ("a+c",))
    with pytest.raises(UsageError, match="training split"):
        plans([], shared, ())


ROWS = [
    Row(
        "a_b",
        "head & co",
        3,
        0,
        2,
        {"abs_rel": 0.1, "delta1": 0.9},
        {"abs_rel": 0.05},
        {"abs_rel": 0.2},
    ),
    Row("c", "median", 0, 3, 0, {}, {}, {}),
]


def test_formats():
    text = formats.text(ROWS).splitlines()
    assert text[1].split() == [
        "a_b",
        "head",
        "&",
        "co",
        "3",
        "0.900",
        "0.100",
        "[0.050,",
        "0.200]",
        "-",
        "-",
        "-",
    ]
    assert text[2].split() == ["c", "median", "0", "-", "-", "-", "-", "-"]
    assert formats.markdown(ROWS).splitlines()[2].startswith("| a_b | head & co | 3 | 0.900 |")
    latex = formats.latex(ROWS)
    assert r"a\_b & head \& co & 3 & 0.900 & 0.100 [0.050, 0.200]" in latex
    assert latex.count(r"\midrule") == 2


SVG = "{http://www.w3.org/2000/svg}"


def drawn(text: str) -> tuple[list[tuple[str, float, float]], int]:
    """The words of a plot with their places, and how many marks it has. Nothing lies outside."""
    root = ElementTree.fromstring(text)
    width, height = float(root.get("width")), float(root.get("height"))
    words = [(n.text, float(n.get("x")), float(n.get("y"))) for n in root.iter(f"{SVG}text")]
    assert all(0 <= x <= width and 0 <= y <= height for _, x, y in words)
    assert max(x for _, x, _ in words) > width / 2 and max(y for *_, y in words) > height / 2
    return words, sum("dot" in (n.get("class") or "").split() for n in root.iter())


def test_a_plot_of_intervals_has_each_row_once():
    rows = [*ROWS, replace(ROWS[0], dataset="b", method="other")]
    words, marks = drawn(plots.intervals(rows, "abs_rel", "A < B"))
    told = [word for word, *_ in words]
    assert [told.count(name) for name in ("A < B", "head & co", "other", "0.100")] == [1, 1, 1, 2]
    assert marks == 2
    place = {word: y for word, _, y in words}
    assert place["a_b"] < place["head & co"] < place["b"] < place["other"]


def test_a_plot_of_calibration_has_a_line_and_a_name_for_each_dataset():
    points = [{"bar": 0.1, "error": 0.2}, {"bar": 0.2, "error": 0.3}]
    text = plots.calibration({"x": points, "z": points[:1]}, "t")
    words, marks = drawn(text)
    assert marks == 3 + 2  # points, and one beside each name
    names = {word: (x, y) for word, x, y in words if word in ("x", "z")}
    assert names["x"][0] == names["z"][0] and names["x"][1] < names["z"][1]
    dots = [float(n.get("cx")) for n in ElementTree.fromstring(text).iter(f"{SVG}circle")]
    assert len(dots) == 3 and max(dots) < names["x"][0]  # of x, its name behind the last


def test_a_head_that_is_no_better_than_a_constant_is_named():
    """The better of the two constants counts; equal is no better."""
    errors = {"constant": 0.2, "constant (L1)": 0.3, "head": 0.2, "good": 0.19}
    assert "d: head does not beat a constant" in no_better("d", errors, "head")
    assert no_better("d", errors, "good") is None and no_better("d", errors, "none") is None
    assert no_better("d", {"head": 0.9}, "head") is None


def test_errors_by_what_the_plain_caption_says(tmp_path):
    """Three images: one whose plain caption holds nothing, one a little, one everything."""
    work = WorkDir(tmp_path)
    plain = {"n_objects": [0, 2, 11], "area_kept": [0.0, 0.3, 0.9]}
    columns = {
        "sample_id": [i for i in "abc" for _ in range(2)],
        "variant": [0, 1] * 3,
        "text": ["x"] * 6,
        "text_id": [b"0" * 16] * 6,
        "n_tokens": [1] * 6,
    }
    for name, values in plain.items():  # the second variant of each: one object, all of its area
        columns[name] = [v for value in values for v in (value, 1)]
    columns |= {"n_kept": columns["n_objects"], "area": columns["area_kept"]}
    table = work.table("d", "captions/x")
    table.bind(Description(stage="captions", schema="captions"))
    kept = schemas.from_columns("captions", columns)
    table.commit(0, kept, Made(ok=3, failed=0, skipped=0, fingerprint="f"))
    rows = [{"sample_id": i, "dataset": "d", "method": "m", "status": "ok"} for i in "abc"]
    metrics = pd.DataFrame([row | dict.fromkeys(known(), k) for k, row in enumerate(rows)])
    found = breakdown.by_description(work, "d", "captions/x", [0], metrics)
    seen = {(r.by, r.value): (r.images, r.abs_rel) for r in found.itertuples()}
    assert seen == {
        ("objects", "0"): (1, 0), ("objects", "1 to 2"): (1, 1), ("objects", "11 and more"): (1, 2),
        ("share covered", "to 25%"): (1, 0), ("share covered", "to 50%"): (1, 1),
        ("share covered", "above"): (1, 2),
    }  # fmt: skip


def test_summary_of_nothing_that_could_be_measured():
    about = {"sample_id": "a", "dataset": "d", "scene": "s", "method": "m"}
    table = to_table([{**about, "status": "failed"}])
    assert summarise(table) == [Row("d", "m", 0, 1, 0, {}, {}, {})]
