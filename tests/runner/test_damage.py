"""Damage to a work dir: each kind is noticed by verify, and what can be made again is."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
import rooms
from click.testing import CliRunner

from rsa_data.cli.main import cli
from rsa_data.common.errors import RsaDataError
from rsa_data.runner import runs, status, verify
from rsa_data.store.tables import Made, WorkDir
from rsa_data.views.report.lineage import lineage

CAPTIONS = "rooms/captions/occupancy"


@pytest.fixture
def work(tmp_path) -> WorkDir:
    work = rooms.made(tmp_path, parts=3)
    runs.run(rooms.captions_job(work), bar=rooms.NoBar)
    assert problems(work) == []
    return work


def problems(work: WorkDir) -> list[str]:
    said: list[str] = []
    count = verify.verify(work, said.append)
    said = [line for line in said if not line.startswith("note:")]
    assert count == len(said) - 1, said
    return said[:-1]


def place(work: WorkDir) -> Path:
    return Path(work.store.location)


def delete(*names: str) -> Callable[[WorkDir], None]:
    def damage(work: WorkDir) -> None:
        for name in names:
            for path in list(place(work).glob(name)):
                path.unlink()

    return damage


def edit(name: str, *where: str, to: object) -> Callable[[WorkDir], None]:
    """Sets one value of a JSON file."""

    def damage(work: WorkDir) -> None:
        path = place(work) / name
        whole = value = json.loads(path.read_text())
        for key in where[:-1]:
            value = value[key]
        value[where[-1]] = to
        path.write_text(json.dumps(whole))

    return damage


def flip(pattern: str) -> Callable[[WorkDir], None]:
    def damage(work: WorkDir) -> None:
        (path,) = place(work).glob(pattern)
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)

    return damage


def copied(old: str, new: str) -> Callable[[WorkDir], None]:
    def damage(work: WorkDir) -> None:
        (path,) = place(work).glob(old)
        (place(work) / new).write_bytes(path.read_bytes())

    return damage


DAMAGE = {
    "no manifest": (delete(f"{CAPTIONS}/_manifest.json"), "expected _manifest.json, since all"),
    "a receipt": (delete(f"{CAPTIONS}/_part-00001.json"), "1 of 3 parts are missing: 1"),
    "a receipt and its data": (
        delete(f"{CAPTIONS}/_part-00001.json", f"{CAPTIONS}/part-00001-*"),
        "the manifest lists part 1, which has no receipt",
    ),
    "the last part and the manifest": (
        delete(f"{CAPTIONS}/*part-00002*", f"{CAPTIONS}/_manifest.json"),
        "1 of 3 parts are missing: 2",
    ),
    "a data file": (delete(f"{CAPTIONS}/part-00001-*"), "found no such file"),
    "a bit": (flip(f"{CAPTIONS}/part-00001-*"), "part 1: expected sha256"),
    "the description": (delete(f"{CAPTIONS}/_table.json"), "expected _table.json"),
    "the samples' description": (delete("rooms/samples/_table.json"), "expected _table.json"),
    "all samples": (delete("rooms/samples/*"), "expected the samples of this dataset"),
    "samples in the middle": (
        delete("rooms/samples/*part-00001*"),
        "rooms/samples: 1 of 3 parts are missing: 1",
    ),
    "samples, manifest and all": (
        delete("rooms/samples/*part-00002*", "rooms/samples/_manifest.json"),
        "part 2: expected parts of the samples only",
    ),
    "an option": (
        edit(f"{CAPTIONS}/_table.json", "options", "variants", to=4),
        "part 0, 1, 2: the fingerprint does not follow from _table.json",
    ),
    "a model's digest": (
        edit(f"{CAPTIONS}/_table.json", "files", to={"model": "0" * 64}),
        "the fingerprint does not follow",
    ),
    "a vocabulary": (
        edit(f"{CAPTIONS}/_table.json", "identity", "tokenizer", to="x"),
        "the fingerprint does not follow",
    ),
    "a fingerprint": (
        edit(f"{CAPTIONS}/_part-00001.json", "fingerprint", to="0" * 64),
        "part 1: the fingerprint does not follow",
    ),
    "the samples' fingerprint": (
        edit("rooms/samples/_part-00001.json", "fingerprint", to="0" * 64),
        "part 1: the fingerprint does not follow",
    ),
    "a split": (
        edit(f"{CAPTIONS}/_part-00001.json", "split", to="test"),
        "expected the split 'train' of its samples, found 'test'",
    ),
    "the samples' split": (
        edit("rooms/samples/_part-00001.json", "split", to="test"),
        "as its rows say; the receipt differs",
    ),
    "a count": (edit(f"{CAPTIONS}/_part-00001.json", "ok", to=49), "the receipt says otherwise"),
    "an input's digest": (
        edit(f"{CAPTIONS}/_part-00001.json", "inputs", "samples", to="0" * 64),
        "its input has changed since",
    ),
    "an input": (
        edit(f"{CAPTIONS}/_part-00001.json", "inputs", to={}),
        "expected the inputs segments/labels, samples",
    ),
    "a part's number": (
        copied(f"{CAPTIONS}/_part-00000.json", f"{CAPTIONS}/_part-00001.json"),
        "its receipt is that of part 0",
    ),
    "a schema version": (
        edit(f"{CAPTIONS}/_table.json", "schema_version", to=99),
        "found 99. Read it with the version of rsa-data that wrote it",
    ),
    "an unknown schema": (
        edit(f"{CAPTIONS}/_table.json", "schema", to="poems"),
        "expected a schema among",
    ),
    "a receipt that is no JSON": (
        lambda work: (place(work) / f"{CAPTIONS}/_part-00001.json").write_text("{"),
        "expected JSON",
    ),
    "a description that is no JSON": (
        lambda work: (place(work) / f"{CAPTIONS}/_table.json").write_text("{"),
        "expected JSON",
    ),
    "the manifest": (
        edit(f"{CAPTIONS}/_manifest.json", "parts", to=[]),
        "the manifest has another receipt",
    ),
    "a file that is not of the table": (
        copied(f"{CAPTIONS}/part-00001-*", f"{CAPTIONS}/part-00001-000000000000.parquet"),
        "expected its parts only; found part-00001-000000000000.parquet",
    ),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damage_is_noticed(work, kind):
    damage, expected = DAMAGE[kind]
    damage(work)
    found = problems(work)
    assert found and expected in "\n".join(found), found


def test_a_work_dir_that_is_not_there_is_an_error(tmp_path):
    for look in (lambda work: verify.verify(work, str), status.status):
        with pytest.raises(RsaDataError, match="expected a work dir; found nothing there"):
            look(WorkDir(tmp_path / "nowhere"))


def test_pipes_devices_and_folders_are_problems_among_others(work):
    """None of them is waited for or read without end, and the rest is checked all the same."""
    (place(work) / "rooms" / "root.txt").symlink_to("/dev/zero")
    for name, kind in (
        ("captions/occupancy/_part-00000.json", "pipe"),
        ("captions/occupancy/_manifest.json", "folder"),
        ("captions/occupancy/_local.json", "pipe"),
        ("segments/labels/_part-00001.json", "device"),
    ):
        path = place(work) / "rooms" / name
        path.unlink(missing_ok=True)
        if kind == "pipe":
            os.mkfifo(path)
        elif kind == "folder":
            path.mkdir()
        else:
            path.symlink_to("/dev/zero")
    flip(f"{CAPTIONS}/part-00002-*")(work)
    found = "\n".join(problems(work))
    assert "committed before is valid" not in found
    for said in (
        "cannot read rooms/root.txt: expected a file, found a pipe, socket or device",
        "cannot read rooms/captions/occupancy/_part-00000.json: expected a file",
        "cannot read rooms/captions/occupancy/_manifest.json: Is a directory",
        "cannot read rooms/captions/occupancy/_local.json: expected a file",
        "cannot read rooms/segments/labels/_part-00001.json: expected a file",
        "rooms/captions/occupancy part 2: expected sha256",
    ):
        assert said in found, found


def test_where_files_lie_is_noted_and_a_broken_note_of_it_is_a_problem(work):
    said: list[str] = []
    assert verify.verify(work, said.append) == 0
    assert "it is not known where the dataset's files lie" in said[0]
    (place(work) / "rooms" / "root.txt").write_bytes(b"\0")
    (place(work) / CAPTIONS / "_local.json").write_text("{")
    first, second = problems(work)
    assert "root.txt: expected where the dataset's files lie" in first
    assert "_local.json: expected JSON" in second and "Delete it" in second


@pytest.mark.parametrize("name", ["_part-00001.json", "_table.json"])
def test_status_names_what_is_broken_and_shows_the_rest(work, name):
    (place(work) / CAPTIONS / name).write_text("<html>")
    done = CliRunner().invoke(cli, ["status", "--work", work.store.location])
    assert done.exit_code == 1 and "1 of its files cannot be read" in str(done.exception)
    lines = {line.split()[0]: line for line in done.output.splitlines() if line.strip()}
    assert lines["samples"].split()[1:3] == ["3/3", "150"]
    assert lines["captions/occupancy"].endswith("cannot be read, see below")
    assert name in lines["broken:"] and "expected JSON" in lines["broken:"]


@pytest.mark.parametrize("log", [None, b'{"a": 1}\n{"event": "part", "seconds": "x"}\n\xff'])
def test_a_broken_log_stops_nothing(work, log):
    (path,) = (place(work) / "logs").glob("rooms.captions.occupancy.*")
    path.unlink()
    if log is None:
        os.mkfifo(path)
    else:
        path.write_bytes(log)
    assert status.status(work).broken == []
    assert "captions/occupancy" in str(lineage(work))


@pytest.mark.parametrize("command", ["status", "verify"])
def test_the_folder_of_a_dataset_is_no_work_dir(work, command):
    done = CliRunner().invoke(cli, [command, "--work", f"{work.store.location}/rooms"])
    assert "found the folder of a dataset in one. Use --work" in str(done.exception)


def test_data_that_is_gone_is_made_again(work):
    table = work.table("rooms", "captions/occupancy")
    before = {n: table.receipt(n) for n in table.parts()}
    delete(f"{CAPTIONS}/part-00001-*")(work)
    summary = runs.run(rooms.captions_job(work), bar=rooms.NoBar)
    assert (summary.done, summary.gone, summary.kept) == (1, 1, 2)
    assert problems(work) == []
    assert {n: table.receipt(n) for n in table.parts()} == before


def test_tables_of_a_newer_version_are_not_read(work):
    edit("rooms/segments/labels/_table.json", "schema_version", to=99)(work)
    with pytest.raises(RsaDataError, match="of the schema segments, or an earlier one; found 99"):
        runs.run(rooms.captions_job(work), bar=rooms.NoBar, start_over=True)


def test_parts_of_several_types_of_cpu_are_noted(work):
    table = work.table("rooms", "captions/occupancy")
    for number, cpu in enumerate(("x86_64 avx2", "x86_64 avx2", "x86_64 avx2 avx512f")):
        edit(f"{CAPTIONS}/_part-{number:05d}.json", "cpu", to=cpu)(work)
    table.manifest(table.parts())
    said: list[str] = []
    assert verify.verify(work, said.append) == 0
    assert "2 on x86_64 avx2; 1 on x86_64 avx2 avx512f" in "\n".join(said)
    assert "made on several types of CPU" in "\n".join(status.status(work).lines)


def test_a_sample_that_stands_in_two_parts_is_noticed(work):
    table = work.table("rooms", "samples")
    first, made = table.read(0), table.receipt(0)
    fields = {name: getattr(made, name) for name in Made.__struct_fields__}
    table.commit(1, first, Made(**fields), redo=True)
    found = [line for line in problems(work) if "expected each sample once" in line]
    assert len(found) == 1
    assert f"found {first['sample_id'][0]} in part 0 and in part 1" in found[0]
