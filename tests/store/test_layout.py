"""Files of a table: other programs open its folder; those of version 0.1 are read and continued."""

import json
from pathlib import Path

import pandas
import pyarrow.dataset
import pytest
import rooms

from rsa_data.common.errors import RsaDataError
from rsa_data.runner import chains, jobs, runs, stages, status, verify
from rsa_data.store.tables import WorkDir

HELPERS = ("table.json", "manifest.json", "local.json", "part-00000.json", "part-00001.json")


@pytest.fixture
def work(tmp_path) -> WorkDir:
    """Samples, segments and captions of two parts."""
    work = rooms.made(tmp_path / "work", parts=2)
    runs.run(rooms.captions_job(work), bar=rooms.NoBar)
    return work


def as_version_0_1(work: WorkDir, folder: Path) -> None:
    """Gives helper files the names that version 0.1 wrote; their content was the same."""
    for path in sorted(folder.rglob("_*.json")):
        assert path.name.removeprefix("_") in HELPERS
        path.rename(path.with_name(path.name.removeprefix("_")))


def test_other_programs_open_the_folder_of_each_table(work, tmp_path):
    for name in work.tables("rooms"):
        table, folder = work.table("rooms", name), tmp_path / "work" / "rooms" / name
        rows = sum(receipt.rows for receipt in table.receipts(table.parts()))
        assert len(pandas.read_parquet(folder)) == rows
        assert pyarrow.dataset.dataset(folder).count_rows() == rows
        duckdb = pytest.importorskip("duckdb")
        assert duckdb.read_parquet(f"{folder}/*.parquet").count("*").fetchall() == [(rows,)]


def test_a_work_dir_of_version_0_1_is_read_verified_and_continued(work, tmp_path):
    as_version_0_1(work, tmp_path / "work")
    before = work.table("rooms", "captions/occupancy").receipt(1)
    assert work.datasets() == ["rooms"]
    assert work.tables("rooms") == ["captions/occupancy", "samples", "segments/labels"]
    assert verify.verify(work, lambda text: None) == 0
    assert not status.stale(work, work.table("rooms", "captions/occupancy"))
    # A part that is lost is made again, under the names that its table has.
    (tmp_path / "work" / "rooms" / "captions" / "occupancy" / "part-00001.json").unlink()
    summary = runs.run(rooms.captions_job(work), bar=rooms.NoBar)
    assert (summary.done, summary.kept) == (1, 1)
    assert work.table("rooms", "captions/occupancy").receipt(1) == before
    assert not list((tmp_path / "work" / "rooms").rglob("_*"))
    # A new table in an old work dir has the new names.
    embed = stages.bind("embed", {"encoder": "minilm"})
    job = jobs.job(work, embed, "rooms", upstream="captions/occupancy")
    runs.run(job, bar=rooms.NoBar)
    assert verify.verify(work, lambda text: None) == 0
    made = [path.name for path in (tmp_path / "work/rooms/embeddings").rglob("*.json")]
    assert sorted({*made}) == sorted(f"_{name}" for name in HELPERS)


def test_starting_over_gives_the_new_names(work, tmp_path):
    as_version_0_1(work, tmp_path / "work")
    runs.run(rooms.captions_job(work), bar=rooms.NoBar, start_over=True)
    folder = tmp_path / "work" / "rooms" / "captions" / "occupancy"
    names = sorted(path.name for path in folder.glob("*.json"))
    assert names == sorted(f"_{name}" for name in HELPERS)
    assert len(pandas.read_parquet(folder)) == 500


def test_new_images_are_added_to_an_index_of_version_0_1(tmp_path):
    given = {"part_size": 2}
    images = tmp_path / "images"
    images.mkdir()
    work = WorkDir(tmp_path / "work")
    for count in (2, 4):
        for number in range(count):
            (images / f"{number}.png").write_bytes(b"")
        chains.samples(work, "folder:mine", given, root=images)
        if count == 2:
            as_version_0_1(work, tmp_path / "work")
    table = work.table("mine", "samples")
    assert table.parts() == [0, 1] and table.complete()
    assert not list((tmp_path / "work").rglob("_*"))


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("_part-00000.json", {"rows": -1}, "rows: expected a whole number >= 0, found -1"),
        ("_part-00000.json", {"rows": "50"}, "rows: expected a whole number, found '50'"),
        ("_part-00000.json", {"colour": 1}, "expected no colour"),
        ("_part-00000.json", {"inputs": {"a": 3}}, "inputs: expected text, found {'a': 3}"),
        ("_table.json", {"stage": None}, "stage: expected text, found nothing"),
        ("_table.json", {"inputs": ["../other"]}, "inputs: expected a path that stays below"),
        ("_table.json", {"options": []}, r"options: expected an object, found \[\]"),
    ],
)
def test_a_changed_helper_file_is_named_with_its_place(work, tmp_path, name, change, words):
    path = tmp_path / "work" / "rooms" / "samples" / name
    path.write_text(json.dumps({**json.loads(path.read_bytes()), **change}))
    table = work.table("rooms", "samples")
    with pytest.raises(RsaDataError, match=rf"{name}.*{words}"):
        table.description(), table.receipt(0)
