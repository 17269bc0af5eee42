"""A full disk: a clear error, everything committed before is valid, and the run goes on after.

A limit on the size of a file stands for the full disk (benchmarks/disk_full.py has a real one).
"""

import resource
import subprocess
import sys
from pathlib import Path

import pytest
import rooms

from rsa_data.common.errors import RsaDataError
from rsa_data.runner import runs, verify


def words(work: Path, *more: str) -> list[str]:
    command = [sys.executable, "-m", "rsa_data", "captions", "--dataset", "rooms"]
    return [*command, "--segments", "labels", "--work", str(work), *more]


def limited(size: int):
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_disk_that_is_full(tmp_path, workers):
    work, whole = rooms.made(tmp_path / "a"), rooms.made(tmp_path / "b")
    # Part 4 is larger than the limit, the four before it are not.
    for each in (work, whole):
        rooms.made(each.store.location, parts=1, rows=2000, first=4)
    runs.run(rooms.captions_job(whole), bar=rooms.NoBar)
    table = whole.table("rooms", "captions/occupancy")
    sizes = [table.receipt(n).bytes for n in table.parts()]
    limit = (max(sizes[:4]) + sizes[4]) // 2
    ended = subprocess.run(
        words(tmp_path / "a", "--workers", workers),
        capture_output=True,
        text=True,
        preexec_fn=limited(limit),
        check=False,
    )
    assert ended.returncode == 1
    assert "cannot write rooms/captions/occupancy/part-00004" in ended.stderr
    assert "File too large. What was committed before is valid" in ended.stderr
    said: list[str] = []
    verify.verify(work, said.append)
    problems = [line for line in said[:-1] if not line.startswith("note: ")]
    assert all("of 5 parts are missing: " in line for line in problems), said
    left = work.table("rooms", "captions/occupancy")
    assert set(left.parts()) <= {0, 1, 2, 3} and left.parts()
    again = subprocess.run(words(tmp_path / "a"), capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stderr
    assert [left.receipt(n) for n in left.parts()] == [table.receipt(n) for n in table.parts()]
    folder = tmp_path / "a/rooms/captions/occupancy"
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


def test_a_folder_that_cannot_be_written_is_an_error_of_ours(tmp_path):
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(RsaDataError, match="cannot write rooms/samples/_table"):
        rooms.made(tmp_path / "file")
