"""Synthetic data is called synthetic wherever its numbers stand, whatever the dataset is called."""

import csv
import io

import pytest
from evaluated import FAST, images
from flat import compare, evaluate, train_head

from rsa_data.heads.card import model_card
from rsa_data.store.tables import WorkDir
from rsa_data.views.report.training import heads

NOTE = "Synthetic: rooms was rendered, not photographed"


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    """A synthetic dataset under a name that does not say so, and another one."""
    work = WorkDir(tmp_path_factory.mktemp("work"))
    for name, builder in (("rooms", "synthetic-indoor"), ("void", "void")):
        images(work, name, 32, "train", builder=builder)
        images(work, name, 8, "test", first_part=1, builder=builder)
    return work


def test_evaluations_comparisons_reports_and_cards_say_so(work):
    trained = train_head(work, epochs=1, **FAST)
    assert "rooms (synthetic): " in trained.summary and "void (synthetic)" not in trained.summary
    evaluate(work, draws=0)
    compare(work, name="c", epochs=1, threads=1, seeds=1, draws=0)
    for folder in ("heads/head/evaluation/rsa", "comparisons/c"):
        for name in ("summary.txt", "summary.md", "summary.tex"):
            text = work.store.read(f"{folder}/{name}").decode()
            assert "rooms (synthetic)" in text and "void (synthetic)" not in text
            assert name == "summary.tex" or NOTE in text
        rows = csv.DictReader(io.StringIO(work.store.read(f"{folder}/summary.csv").decode()))
        assert {(row["dataset"], row["synthetic"]) for row in rows} == {
            ("rooms", "yes"),
            ("void", "no"),
        }
    assert "rooms (synthetic)" in work.store.read("comparisons/c/abs_rel.svg").decode()
    page = heads(work)
    assert page.count("rooms (synthetic)") > 4 and page.count(NOTE) == 2
    card = model_card("head", trained.description, work)
    assert "rooms: Synthetic: its images were rendered" in card and NOTE in card


@pytest.mark.parametrize(("datasets", "only"), [(("rooms",), True), (("rooms", "void"), False)])
def test_a_head_knows_that_it_saw_nothing_real(work, datasets, only):
    name = "+".join(datasets).replace("+", "-")
    about = train_head(work, name=name, datasets=datasets, epochs=1, **FAST).about
    assert about.only_synthetic is only
