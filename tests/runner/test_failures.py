"""Rows that fail: how many are too many at the end of a run, and retry-failed."""

import io
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from rsa_data.cli.main import cli
from rsa_data.store.tables import WorkDir


def png() -> bytes:
    good = io.BytesIO()
    Image.fromarray(np.arange(12, dtype=np.uint8).reshape(3, 4) % 3).save(good, "PNG")
    return good.getvalue()


def write(folder: Path, count: int, broken: int = 0) -> Path:
    """A folder of so many pictures, of which the first ones are no pictures."""
    folder.mkdir(exist_ok=True)
    for number in range(count):
        data = b"broken" if number < broken else png()
        (folder / f"{number:02d}.png").write_bytes(data)
    return folder


@pytest.fixture
def call(tmp_path):
    """A command over images of which there are 16, in a work dir."""
    images = write(tmp_path / "images", 16)

    def run(*words: object) -> Result:
        named = ("--dataset", "folder:mine", "--root", images) if words[0] == "detect" else ()
        return CliRunner().invoke(cli, [*map(str, (*words, *named)), "--work", str(tmp_path / "w")])

    return run


@pytest.mark.parametrize(
    ("broken", "most", "says"),
    [
        (14, (), ""),
        (15, (), "15 of 16 rows failed, more than --max-failures 0.9 of the rows"),
        (15, ("--max-failures", "15"), ""),
        (15, ("--max-failures", "14"), "15 of 16 rows failed, more than --max-failures 14"),
        (15, ("--max-failures", "100%"), ""),
        (16, ("--max-failures", "100%"), "all 16 rows failed. 16 times, such as: "),
    ],
)
def test_too_many_failures_at_the_end_of_a_run_are_a_failure(call, tmp_path, broken, most, says):
    labels = write(tmp_path / "labels", 16, broken)
    result = call("detect", "--segments", f"labels:{labels}", "--names", "nyu13", *most)
    assert (result.exit_code, "next: " in result.output) == ((1, False) if says else (0, True))
    assert says in str(result.exception or "")
    if "stopped" not in str(result.exception):  # a count ends a run at once, without a summary
        assert f"{16 - broken} samples ok, {broken} failed" in result.output or broken == 16


def test_retry_failed_goes_on_after_a_table_whose_every_row_still_fails(call, tmp_path):
    for name in ("a", "b"):
        labels = write(tmp_path / name, 16, 16)
        words = ("--segments", f"labels:{labels}", "--names", "nyu13", "--label", name)
        assert call("detect", *words).exit_code == 1
    write(tmp_path / "b", 16)
    result = call("retry-failed")
    assert result.exit_code == 1 and "all 16 rows failed" in str(result.exception)
    tables = (WorkDir(tmp_path / "w").table("mine", f"segments/{name}") for name in "ab")
    assert [table.receipt(0).ok for table in tables] == [0, 16]


def test_retry_failed_keeps_to_its_options(call, tmp_path):
    labels = write(tmp_path / "labels", 16, 2)
    split = ("--dataset-option", "part_size=4")
    call("detect", "--segments", f"labels:{labels}", "--names", "nyu13", *split)
    write(labels, 16)
    assert "nothing to do: 3 parts" in call("retry-failed", "--part-range", "1:4").output
    assert "--start-over" in str(call("retry-failed", "--start-over").exception)
    assert "16 samples ok" in call("retry-failed", "--part-range", "0:4").output
