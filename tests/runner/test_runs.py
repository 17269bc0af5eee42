"""Runs of a stage: what is out of date, what fails, what ends a run early, two runs at once."""

import hashlib
import io
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import rooms
from click.testing import CliRunner
from msgspec.structs import replace
from PIL import Image

from rsa_data.cli.console import summary_lines
from rsa_data.cli.main import cli
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.embeddings.runtime import native_precision
from rsa_data.runner import (
    fingerprints,
    jobs,
    limits,
    parts,
    plan,
    recompute,
    runs,
    stages,
    status,
    verify,
)
from rsa_data.store import schemas
from rsa_data.store.tables import Description, Made, WorkDir, to_json


def captions(work: WorkDir, **how: object) -> runs.Summary:
    return runs.run(rooms.captions_job(work), bar=rooms.NoBar, **how)


def change_segments(work: WorkDir, number: int) -> None:
    """As if the detector had found something else in one part."""
    table = work.table("rooms", "segments/labels")
    receipt, rows = table.receipt(number), table.read(number)
    labels = [["sofa" for _ in found] for found in rows["label"].to_pylist()]
    at = rows.schema.get_field_index("label")
    changed = rows.set_column(
        at, rows.schema.field("label"), pa.array(labels, pa.list_(pa.string()))
    )
    table.commit(number, changed, receipt, redo=True)
    table.manifest(table.parts())


def test_a_changed_input_is_seen_and_only_its_part_is_made_again(tmp_path):
    work = rooms.made(tmp_path)
    captions(work)
    change_segments(work, 2)
    table = work.table("rooms", "captions/occupancy")
    assert status.outdated(work, table) == {2}
    assert "1 parts out of date" in "\n".join(status.status(work).lines)
    said: list[str] = []
    assert verify.verify(work, said.append) == 1
    assert said[0].endswith("part 2: its input has changed since: run the stage again")
    before = {n: table.receipt(n) for n in table.parts()}
    assert (summary := captions(work)).done == summary.stale == 1
    assert [n for n in table.parts() if table.receipt(n) != before[n]] == [2]
    assert verify.verify(work, said.append) == 0
    files = [name for name in work.store.list(table.path) if name.endswith(".parquet")]
    assert sorted(files) == sorted(table.receipt(n).file for n in table.parts())


def test_what_was_made_from_something_out_of_date_is_out_of_date(tmp_path):
    work = rooms.made(tmp_path, parts=2)
    captions(work)
    made_from = {n: work.table("rooms", "captions/occupancy").receipt(n) for n in (0, 1)}
    embeddings = work.table("rooms", "embeddings/occupancy/minilm")
    version = stages.stage("embed").version
    embeddings.bind(
        Description(
            stage="embed",
            stage_version=version,
            schema="embeddings",
            inputs=["captions/occupancy"],
        )
    )
    rows = {"text_id": [b"0" * 16], "n_tokens": [1], "truncated": [False]}
    feature = pa.array([b"\0\0"], pa.binary(2))
    field = pa.field("embedding", feature.type, False, {"dtype": "float16", "shape": "1"})
    made = schemas.from_columns("embeddings", {**rows, "embedding": (field, feature)})
    counts = {"ok": 1, "failed": 0, "skipped": 0, "split": "train", "fingerprint": "f"}
    for number in (0, 1):
        source = {"captions/occupancy": made_from[number].digest}
        embeddings.commit(number, made, Made(**counts, inputs=source))
    assert status.outdated(work, embeddings) == set()
    change_segments(work, 1)
    assert status.outdated(work, embeddings) == {1}


def test_other_options_are_refused_and_start_over_makes_all_anew(tmp_path):
    work = rooms.made(tmp_path)
    captions(work)
    job = rooms.captions_job(work, variants=2)
    with pytest.raises(RsaDataError, match=r"options.variants: the table has 5, this run has 2"):
        runs.run(job, bar=rooms.NoBar)
    assert runs.run(job, bar=rooms.NoBar, start_over=True).rows == 4 * 50 * 2


def test_part_ranges_together_make_the_whole(tmp_path):
    work, apart = rooms.made(tmp_path / "a"), rooms.made(tmp_path / "b")
    captions(work)
    for part_range in ((2, 4), (0, 1), (1, 2)):
        captions(apart, part_range=part_range)
    one, two = (w.table("rooms", "captions/occupancy") for w in (work, apart))
    assert one.stored_manifest() == two.stored_manifest() is not None


def test_parts_written_by_another_parquet_library_stay(tmp_path):
    work = rooms.made(tmp_path)
    captions(work, part_range=(0, 2))
    table = work.table("rooms", "captions/occupancy")
    for number in (0, 1):
        # Other row groups, pages, compression, encodings, format version and names of list items.
        receipt, path = table.receipt(number), tmp_path / table.path
        older = path / "older.parquet"
        pq.write_table(
            table.read(number),
            older,
            row_group_size=7,
            compression="snappy",
            version="1.0",
            data_page_version="2.0",
            use_dictionary=False,
            use_compliant_nested_type=False,
        )
        data = older.read_bytes()
        name = f"part-{number:05d}-{'0' * 12}.parquet"
        (path / receipt.file).unlink()
        older.rename(path / name)
        sha256 = hashlib.sha256(data).hexdigest()
        changed = replace(receipt, file=name, bytes=len(data), sha256=sha256)
        table.store.write(f"{table.path}/_part-{number:05d}.json", to_json(changed))
    assert (summary := captions(work)).done == 2 and summary.kept == 2
    said: list[str] = []
    assert verify.verify(work, said.append) == 0, said
    assert recompute.recompute(work, 4, said.append) == 0, said
    other = rooms.made(tmp_path / "other")
    captions(other)
    new = other.table("rooms", "captions/occupancy")
    assert [table.receipt(n).digest for n in table.parts()] == [
        new.receipt(n).digest for n in new.parts()
    ]


def test_verify_finds_each_kind_of_damage(tmp_path):
    work = rooms.made(tmp_path)
    captions(work)
    table = work.table("rooms", "captions/occupancy")
    files = {n: tmp_path / table.path / table.receipt(n).file for n in table.parts()}
    data = bytearray(files[0].read_bytes())
    data[len(data) // 2] ^= 1
    files[0].write_bytes(data)
    files[1].unlink()
    receipt = replace(table.receipt(2), ok=49, skipped=1)
    table.store.write(f"{table.path}/_part-00002.json", to_json(receipt))
    said: list[str] = []
    assert verify.verify(work, said.append) == 4
    text = "\n".join(said)
    assert re.search(r"part 0: expected sha256 \w+\.\.\., found", text)
    assert re.search(r"part 1: expected part-00001-\w+.parquet, found no such file", text)
    assert re.search(r"part 2: expected \{'ok': 50.*the receipt says otherwise", text)
    assert "part 2: the manifest has another receipt" in text
    with pytest.raises(RsaDataError, match="part 0 cannot be read: expected sha256"):
        table.read(0, check=True)


def test_recompute_names_what_comes_out_otherwise(tmp_path):
    work = rooms.made(tmp_path, parts=1)
    captions(work)
    table = work.table("rooms", "captions/occupancy")
    rows = table.read(0)
    areas = rows["area"].to_numpy()
    for factor, problems, words in ((1.001, 0, "equal within 0.002"), (1.02, 1, "column area")):
        at = rows.schema.get_field_index("area")
        area = pa.array((areas * factor), rows.schema.field("area").type)
        other = rows.set_column(at, rows.schema.field("area"), area)
        table.commit(0, other, table.receipt(0), redo=True)
        said: list[str] = []
        assert recompute.recompute(work, 3, said.append) == problems
        assert words in said[-1]


def test_inputs_that_are_not_those_of_the_stage_are_named(tmp_path):
    work = rooms.made(tmp_path, parts=1)
    captions(work)
    path = tmp_path / "rooms" / "captions" / "occupancy" / "_table.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "inputs": ["samples"]}))
    with pytest.raises(RsaDataError, match="expected the inputs of the stage captions, found"):
        recompute.recompute(work, 1, str)


@pytest.mark.parametrize(
    "text, value", [("5%", 0.05), ("0.25", 0.25), ("100", 100), ("0", 0), ("100%", 1.0)]
)
def test_max_failures_is_a_share_or_a_count(text, value):
    assert limits.parse_failures(text) == value
    assert type(limits.parse_failures(text)) is type(value)


@pytest.mark.parametrize("text", ["", "-1", "200%", "1.5", "many"])
def test_max_failures_that_make_no_sense(text):
    with pytest.raises(UsageError, match="expected a count such as 100 or a share such as 5%"):
        limits.parse_failures(text)


def test_too_many_failures_stop_a_run_with_the_reasons():
    def reasons() -> list[tuple[str, int]]:
        return [("no such file", 19), ("an empty file", 1)]

    limits.check_failures(20, 100, 20, reasons)
    limits.check_failures(20, 100, 0.2, reasons)
    limits.check_failures(9, 9, 0.5, reasons)
    with pytest.raises(RsaDataError, match="20 of 100 rows failed, more than --max-failures 19"):
        limits.check_failures(20, 100, 19, reasons)
    reasons_told = "19 times, such as: no such file; 1 times, such as: an empty file"
    with pytest.raises(RsaDataError, match=reasons_told):
        limits.check_failures(20, 100, 0.1, reasons)


def test_a_run_that_will_not_fit_stops_early_and_goes_on_later(tmp_path, monkeypatch):
    work = rooms.made(tmp_path, parts=8)
    usage = shutil.disk_usage(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr("shutil.disk_usage", lambda place: usage._replace(free=10_000))
        with pytest.raises(
            RsaDataError, match=r"the parts that are left need about .* kB, 10.0 kB"
        ):
            captions(work)
        table = work.table("rooms", "captions/occupancy")
        assert 1 <= len(table.parts()) < 8
        with pytest.raises(RsaDataError, match="are free"):
            captions(work)
    assert captions(work).rows == 8 * 50 * 5


def test_a_plan_writes_nothing_and_is_about_right(tmp_path):
    work = rooms.made(tmp_path, parts=6, rows=500)
    estimate = plan.plan(rooms.captions_job(work))
    assert not work.table("rooms", "captions/occupancy").exists()
    summary = captions(work)
    assert (estimate.parts, estimate.rows, estimate.parts_done) == (6, 3000, 0)
    assert 0.3 * summary.bytes < estimate.bytes < 4 * summary.bytes
    after = plan.plan(rooms.captions_job(work))
    assert (after.parts, after.rows, after.parts_done) == (0, 0, 6)


@pytest.mark.slow
def test_two_commands_at_once_on_one_work_dir(tmp_path):
    work, alone = rooms.made(tmp_path / "a", parts=12), rooms.made(tmp_path / "b", parts=12)
    captions(alone)
    words = [sys.executable, "-m", "rsa_data", "captions", "--dataset", "rooms"]
    words += ["--segments", "labels", "--work", str(tmp_path / "a")]
    both = [
        subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        for _ in range(2)
    ]
    outputs = [process.communicate(timeout=300)[0] for process in both]
    assert [process.returncode for process in both] == [0, 0], outputs

    def files(folder: Path) -> dict[str, bytes]:
        return {p.name: p.read_bytes() for p in (folder / "rooms/captions/occupancy").iterdir()}

    assert files(tmp_path / "a") == files(tmp_path / "b")
    assert verify.verify(work, lambda text: None) == 0


def test_two_commands_with_other_options_at_once_do_not_mix(tmp_path):
    work = rooms.made(tmp_path, parts=2)
    description = fingerprints.describe(job := rooms.captions_job(work))
    table = work.table("rooms", "captions/occupancy")
    table.bind(description)
    step = parts.build_step(job, description)
    # Another run deletes the table and begins it with other options while a part is being made.
    table.start_over()
    table.bind(fingerprints.describe(rooms.captions_job(work, variants=2)))
    with pytest.raises(RsaDataError, match="another run changed the input or the options"):
        parts.run_part(job, step, description, 0)
    assert table.parts() == []


def test_what_was_refused_does_not_stand_in_the_way(tmp_path):
    """A call that fails before its first part leaves nothing that the right call must delete."""
    work = rooms.made(tmp_path, parts=2)
    table = work.table("rooms", "captions/occupancy")
    table.bind(fingerprints.describe(rooms.captions_job(work, variants=2)))
    assert jobs.choose(work, "rooms", "captions", None, "--style") == "captions/occupancy"
    work.table("rooms", "captions/other").bind(fingerprints.describe(rooms.captions_job(work)))
    assert captions(work).done == 2
    assert table.description().options["variants"] == 5
    # The other one, without any part, is no choice.
    assert jobs.choose(work, "rooms", "captions", None, "--style") == "captions/occupancy"
    with pytest.raises(RsaDataError, match="made with other options"):
        runs.run(rooms.captions_job(work, variants=2), bar=rooms.NoBar)


def test_a_range_says_what_it_leaves(tmp_path):
    work = rooms.made(tmp_path, parts=3)
    some = runs.run(rooms.captions_job(work), part_range=(0, 1), bar=rooms.NoBar)
    assert (some.done, some.left) == (1, 2)
    assert "still to be made: 2 parts" in "\n".join(summary_lines("captions", "rooms", some))
    none = runs.run(rooms.captions_job(work), part_range=(7, 9), bar=rooms.NoBar)
    assert "no part in this range" in "\n".join(summary_lines("captions", "rooms", none))


def test_failed_rows_are_tried_again_on_request(tmp_path):
    work = rooms.made(tmp_path, parts=2)
    captions(work)
    table = work.table("rooms", "captions/occupancy")
    good = table.receipt(1)
    table.store.write(f"{table.path}/_part-00001.json", to_json(replace(good, ok=49, failed=1)))
    with pytest.raises(RsaDataError):  # captions never fail: the table has no such column
        captions(work)
    job = rooms.captions_job(work)
    assert runs.run(job, bar=rooms.NoBar, redo_failed=True).done == 1
    assert table.receipt(1) == good


def test_mended_inputs_are_taken_in_by_retry_failed(tmp_path):
    images, labels, work = tmp_path / "images", tmp_path / "labels", tmp_path / "work"
    good = io.BytesIO()
    Image.fromarray(np.arange(12, dtype=np.uint8).reshape(3, 4) % 3).save(good, "PNG")
    for number in range(6):
        for folder in (images, labels):
            folder.mkdir(exist_ok=True)
            (folder / f"{number}.png").write_bytes(good.getvalue())
    (labels / "4.png").write_bytes(b"broken")

    def call(*words: object) -> str:
        result = CliRunner().invoke(cli, [*map(str, words), "--work", str(work)])
        assert result.exit_code == 0, result.output
        return result.output

    wanted = ("--dataset", "folder:mine", "--root", images, "--dataset-option", "part_size=2")
    call("detect", *wanted, "--segments", f"labels:{labels}", "--names", "nyu13")
    call("captions", "--dataset", "mine", "--segments", "labels", "--style", "classes")
    segments, captions_ = (
        WorkDir(work).table("mine", name) for name in ("segments/labels", "captions/classes")
    )
    counts = ("ok", "failed", "skipped")
    assert [getattr(segments.receipt(2), k) for k in counts] == [1, 1, 0]
    assert [getattr(captions_.receipt(2), k) for k in counts] == [1, 0, 1]
    (labels / "4.png").write_bytes(good.getvalue())
    out = call("retry-failed")
    assert "captions mine: 6 samples ok" in out
    assert [getattr(segments.receipt(2), k) for k in counts] == [2, 0, 0]
    assert [getattr(captions_.receipt(2), k) for k in counts] == [2, 0, 0]
    assert call("retry-failed") == ""
    # As a run leaves it that was killed between its last part and the manifest.
    manifest = work / "mine/segments/labels/_manifest.json"
    whole = manifest.read_bytes()
    manifest.unlink()
    assert "nothing to do: 3 parts" in call("retry-failed")
    assert manifest.read_bytes() == whole


def test_start_over_with_auto_precision_chooses_again(tmp_path):
    work = rooms.made(tmp_path, parts=1)
    captions(work)
    chosen = native_precision("torch", "auto")
    other = "float32" if chosen != "float32" else "bfloat16"
    tables = {}
    for precision, over in ((other, False), ("auto", False), ("auto", True)):
        options = {"encoder": "minilm", "runtime": "torch", "precision": precision}
        job = jobs.job(
            work, stages.bind("embed", options), "rooms", upstream="captions/occupancy",
            start_over=over,
        )  # fmt: skip
        if not tables:
            work.table("rooms", job.output).bind(fingerprints.describe(job))
        tables[precision, over] = job.options["precision"]
    assert list(tables.values()) == [other, other, chosen]


def test_start_over_with_a_wrong_split_keeps_the_table(tmp_path):
    work = rooms.made(tmp_path, parts=2)
    captions(work)
    with pytest.raises(RsaDataError, match="split"):
        captions(work, start_over=True, split="nowhere")
    assert work.table("rooms", "captions/occupancy").parts() == [0, 1]
