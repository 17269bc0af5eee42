"""compare: one table of every input, with what surrounds it."""

import dataclasses

import numpy as np
import pytest
from evaluated import images
from flat import compare

from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.evaluation.compare import Recipe, merge_seeds
from rsa_data.evaluation.contenders import inputs_of
from rsa_data.heads.train.plan import Training
from rsa_data.store.tables import Description, WorkDir

TEXTS = [["a 0", "a 1", "a 2"], ["a 1", "a 2", "a 3"], ["a 2", "a 3", "a 0"], ["a 3", "a 0", "a 1"]]


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> WorkDir:
    work = WorkDir(tmp_path_factory.mktemp("work"))
    for dataset in ("nyuv2", "void"):
        images(work, dataset, 32, "train", texts=TEXTS * 8)
        images(work, dataset, 8, "test", first_part=1, texts=TEXTS * 2)
    return work


@pytest.fixture(scope="module")
def found(work):
    return compare(work, name="c", epochs=1, threads=1, seeds=2, draws=50)


def test_every_kind_of_row_is_there(found):
    rows = {(row.dataset, row.method): row for row in found.rows}
    shared = ["text", "text, one description a scene", "captions shuffled", "dataset name only"]
    constants = ["constant", "constant (L1)", "joint constant"]
    oracles = ["median", "linear fit", "linear fit in depth"]
    for dataset, other in (("nyuv2", "void"), ("void", "nyuv2")):
        own = [f"text, {dataset} alone", f"text, {other} alone (zero-shot)"]
        methods = [method for name, method in rows if name == dataset]
        assert sorted(methods) == sorted(shared + own + constants + oracles)
    assert {row.images for row in found.rows} == {8}
    assert {row.scenes for row in found.rows} == {2}


def test_errors_are_averaged_over_seeds(found):
    frame = found.table.to_pandas()
    rows = {(row.dataset, row.method): row for row in found.rows}
    pair = frame[(frame["dataset"] == "void") & frame["method"].str.startswith("text #")]
    assert set(pair["method"]) == {"text #0", "text #1"}
    assert rows["void", "text"].mean["abs_rel"] == pytest.approx(pair["abs_rel"].mean())
    apart = pair.groupby("method")["abs_rel"].mean().std()
    assert f"void: text: AbsRel over seeds +- {apart:.4f}" in found.summary


def test_hard_images_error_bars_and_files(work, found):
    assert "nyuv2: AbsRel of hard images" in found.summary
    assert "void: spread over 2 caption variants" in found.summary
    assert set(work.store.list(found.folder)) == {
        "_evaluation.json",
        "abs_rel.svg",
        "calibration.svg",
        "paired.csv",
        "metrics.parquet",
        *(f"summary.{ending}" for ending in ("csv", "md", "tex", "txt")),
    }


def test_heads_that_are_trained_are_taken_as_they_are(work, found):
    before = work.store.read("heads/c-text-0/head.safetensors")
    again = compare(work, name="c", epochs=1, threads=1, seeds=2, draws=50)
    assert again.summary == found.summary
    assert work.store.read("heads/c-text-0/head.safetensors") == before


def test_a_dataset_that_is_never_trained_on(work, found):
    images(work, "sunrgbd", 8, "test", texts=TEXTS * 2)
    shown = compare(work, name="z", epochs=1, threads=1, draws=0, zero_shot=("void",))
    methods = {
        name: [r.method for r in shown.rows if r.dataset == name] for name in ("void", "sunrgbd")
    }
    for name, constants in (("void", ["constant", "constant (L1)"]), ("sunrgbd", [])):
        trained = ["text (zero-shot)", "text, one description a scene (zero-shot)"]
        assert methods[name][:2] == trained
        assert [m for m in methods[name] if "constant" in m] == [*constants, "joint constant"]
        assert not any("alone" in m for m in methods[name])


def test_heads_of_a_comparison_are_trained_as_others_are():
    own = {f.name: f.default for f in dataclasses.fields(Training)}
    shared = {f.name: f.default for f in dataclasses.fields(Recipe)} | {"epochs": own["epochs"]}
    assert {name: own[name] for name in shared.keys() & own} == {
        name: shared[name] for name in shared.keys() & own
    }


def test_one_seed_needs_no_merging(found):
    frame = found.table.to_pandas()
    one = found.table.filter(np.asarray(~frame["method"].str.endswith("#1")))
    _, lines = merge_seeds(one)
    assert lines == []


def test_text_must_be_there_and_only_one(work):
    assert inputs_of(work, ["nyuv2", "void"], None, None)["text"] == [("occupancy", "minilm")]
    with pytest.raises(RsaDataError, match="rsa-data embed"):
        inputs_of(work, ["nyuv2"], "counts", None)
    work.table("nyuv2", "embeddings/counts/minilm").bind(
        Description(stage="embed", schema="embeddings")
    )
    with pytest.raises(UsageError, match="counts/minilm, occupancy/minilm"):
        inputs_of(work, ["nyuv2"], None, None)
