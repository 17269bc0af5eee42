"""The report: what stands in it, that nothing breaks out, and how large it gets."""

import json
import shutil
from html.parser import HTMLParser

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import report_work
import rooms

from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.store.tables import WorkDir
from rsa_data.views.report.build import report
from rsa_data.views.report.features_map import components, scene_type
from rsa_data.views.report.training import heads


class Page(HTMLParser):
    """Elements as (name, attributes), and all text outside of script and style."""

    def __init__(self, text: str):
        super().__init__()
        self.elements: list[tuple[str, dict]] = []
        self.words, self.inside = [], []
        self.feed(text)

    def handle_starttag(self, name, attributes):
        self.elements.append((name, dict(attributes)))
        self.inside.append(name)

    def handle_endtag(self, name):
        while self.inside and self.inside.pop() != name:
            pass

    def handle_data(self, data):
        if not self.inside or self.inside[-1] not in ("script", "style"):
            self.words.append(data)

    def all(self, name):
        return [attributes for found, attributes in self.elements if found == name]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    work = report_work.made(folder)
    result = report(work, out=folder / "report.html")
    return Page(result.path.read_text("utf-8"))


def test_has_every_section_and_says_what_failed(page):
    words = " ".join(page.words)
    headings = ("What was run", "Samples", "Segments", "Captions", "Features, scale and shift")
    for part in (*headings, "Heads", "Head small", "embeddings/occupancy/minilm"):
        assert part in words
    assert "the weights of epoch 3 were kept" in words
    for title in ("wrong or poor, protocol rsa", "Comparison rsa", "on test images", "8 images"):
        assert title in words
    assert "paper: rooms: the paper reports nothing on folder" in words


def test_training_images_show_the_pixels_that_were_drawn(page):
    drawn = [a["alt"] for a in page.all("img") if a["alt"].startswith("Relative depth (across)")]
    assert len(drawn) == 8 and all("of 64 pixels" in alt for alt in drawn)


def test_a_head_that_beats_no_constant_is_named(page):
    words = " ".join(page.words)
    assert "roads: head small does not beat a constant scale and shift in AbsRel" in words
    assert words.count("does not beat a constant") == 1 + 1  # evaluation and robustness


def test_texts_of_data_are_shown_and_never_run(page):
    assert len(page.all("script")) == 1
    assert report_work.EVIL in " ".join(page.words)
    for name, attributes in page.elements:
        assert not [key for key in attributes if key.startswith("on")], name


def test_needs_no_network(page):
    places = [a.get("src") or a.get("href") for _, a in page.elements]
    assert {p[:5] for p in places if p} <= {"data:", *("#" + s[:4] for s in (
        "run", "samples", "segments", "captions", "features", "heads"))}  # fmt: skip


def test_each_plot_has_a_name_units_and_its_numbers(page):
    plots = [a for a in page.all("svg") if a.get("role") == "img"]
    assert len(plots) >= 10
    titles = {a["id"] for a in page.all("title") if "id" in a}
    assert {a["aria-labelledby"] for a in plots} <= titles
    figures = [a for a in page.all("figure") if a.get("class") == "plot"]
    assert len(figures) == len(plots) <= len(page.all("details"))
    assert all(a.get("alt") for a in page.all("img"))


def test_cards_carry_what_filters_look_at(page):
    cards = [a for a in page.all("article") if "card" in a.get("class", "")]
    assert {a["data-dataset"] for a in cards} == {"rooms", "roads"}
    assert {a["data-split"] for a in cards} == {"train", "test"}
    assert sum(a["data-failed"] == "yes" for a in cards) == 4
    assert sum("|bed|" in a["data-class"] for a in cards) == 4


def test_unknown_head_and_empty_work_dir_are_refused(tmp_path):
    work = rooms.made(tmp_path / "work", parts=1, rows=5)
    with pytest.raises(UsageError, match="head 'x': expected one of none yet"):
        report(work, out=tmp_path / "r.html", head="x")
    with pytest.raises(RsaDataError, match="no dataset there yet"):
        report(WorkDir(tmp_path / "none"), out=tmp_path / "r.html")


@pytest.mark.parametrize(
    ("options", "unit"),
    [
        ({"loss": "l1", "units": "metres"}, "l1 of depth (m)"),
        ({"loss": "huber", "units": "relative"}, "huber of depth (share of mean depth)"),
        ({"loss": "silog", "units": "metres"}, "silog of depth"),
        ({"loss": "l1", "units": "metres", "supervision": "fit"}, "l1 of fit"),
        ({"loss": "gone:LOSS", "units": "metres"}, "gone:LOSS of depth"),
    ],
)
def test_only_a_loss_in_metres_has_a_unit(tmp_path, options, unit):
    folder = tmp_path / "heads/x"
    folder.mkdir(parents=True)
    about = {"format": 1, "architecture": {"name": "linear"}, "features": {"dim": 8}}
    (folder / "head.json").write_text(json.dumps({**about, "options": options}))
    row = {"epoch": 1, "dataset": "a", "train_loss": 0.5, "val_abs_rel": 0.1, "best": True}
    rows = [row, {**row, "epoch": 2, "best": False}]
    pq.write_table(pa.Table.from_pylist(rows), folder / "history.parquet")
    shown = str(heads(WorkDir(tmp_path)))
    assert f">{unit}<" in shown


def test_components_are_those_of_a_plane():
    import numpy as np

    random = np.random.default_rng(0)
    plane = np.zeros((50, 6))
    plane[:, 2], plane[:, 4] = random.normal(size=50) * 3, random.normal(size=50)
    places, share = components(plane + 7)
    assert share.sum() == pytest.approx(1)
    distances = np.linalg.norm(plane[:, None] - plane[None], axis=-1)
    found = np.linalg.norm(places[:, None] - places[None], axis=-1)
    np.testing.assert_allclose(found, distances, atol=1e-9)


@pytest.mark.parametrize(
    ("scene", "found"),
    [
        ("bathroom", "nyuv2: bathroom"),
        ("bathroom_0012", "nyuv2: bathroom"),
        ("2011_09_26_drive_0002_sync", "nyuv2"),
        ("chess/seq-01", "nyuv2: chess/seq"),
        ("nyuv2", "nyuv2"),
    ],
)
def test_type_of_a_scene_is_its_name_without_numbers(scene, found):
    assert scene_type("nyuv2", scene) == found


@pytest.mark.slow
def test_100_000_images_stay_below_10_mb(tmp_path):
    work = rooms.made(tmp_path / "work", parts=50, rows=2000)
    result = report(work, out=tmp_path / "r.html")
    assert result.path.stat().st_size < 10_000_000
    assert "all 100,000 images" in result.path.read_text("utf-8")


@pytest.mark.parametrize("content", ["<html>", "null", "", '{"format": 1}', '{"format": NaN}'])
def test_a_broken_head_is_left_out_and_named(tmp_path, content):
    work = report_work.made(tmp_path)
    place = tmp_path / "work" / "heads"
    shutil.copytree(place / "small", place / "broken")
    (place / "broken" / "head.json").write_text(content)
    with pytest.warns(UserWarning, match=r"the head broken is left out: .*/broken/head\.json"):
        page = Page(report(work, out=tmp_path / "r.html", samples=2).path.read_text("utf-8"))
    words = " ".join(page.words)
    assert "the head broken is left out" in words and "Head small" in words
    assert "Head broken" not in words


def test_damage_beside_a_head_is_told_in_its_place(tmp_path):
    work = report_work.made(tmp_path)
    place = tmp_path / "work"
    for folder in ("heads/small/robustness", "comparisons"):
        (place / folder / "rsa" / "summary.csv").write_bytes(b"dataset,images\nrooms,\xff\n")
    (place / "heads" / "small" / "history.parquet").write_bytes(b"PAR1")
    with pytest.warns(UserWarning, match="not shown in the report"):
        page = Page(report(work, out=tmp_path / "r.html", samples=2).path.read_text("utf-8"))
    words = " ".join(page.words)
    assert words.count("Not shown: ") == 3 and "on test images" in words
