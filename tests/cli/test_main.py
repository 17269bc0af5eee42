"""The command line: help with examples, exit status, errors that say the way out."""

import subprocess
import sys

import pytest
from click.testing import CliRunner

from rsa_data.cli import main


def run(*words: str, **more):
    """The real console script in a process of its own."""
    code = "from rsa_data.cli.main import main; main()"
    return subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, check=False, **more
    )


@pytest.mark.parametrize("name", main.COMMANDS)
def test_every_command_has_help_with_an_example(name):
    result = CliRunner().invoke(main.cli, [name, "--help"])
    assert result.exit_code == 0, result.output
    assert f"rsa-data {name}" in result.output


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (["caption"], 2, "Did you mean 'captions'?"),
        (["captions"], 2, "--dataset"),
        (["captions", "--dataset", "nyuv"], 2, "Did you mean 'nyuv2'?"),
        (["captions", "--dataset", "nyuv2"], 1, "data/README.md"),
        (["captions", "--dataset", "nyuv2", "--root", "nowhere"], 1, "nowhere"),
        (["captions", "--dataset", "nyuv2", "--part-range", "3"], 2, "expected FIRST:LAST"),
        (["captions", "--dataset", "folder:x", "--dataset-option", "depth_uni=m"], 2, "depth_unit"),
        (["embed"], 1, "no dataset there yet"),
        (["embed", "--dataset", "nyuv2"], 2, "unknown dataset"),
        (["run", "no-such-job"], 2, "demo"),
        (["list", "dataset"], 2, "Did you mean 'datasets'?"),
        (["verify", "--work", "ftp://x/y"], 1, "ftp://x/y"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_wrong_calls(words, status, message, tmp_path):
    ended = run(*words, cwd=tmp_path)
    assert (ended.returncode, message in ended.stderr) == (status, True), ended.stderr
    assert "Traceback" not in ended.stderr


def test_list_names_everything():
    listed = run("list").stdout
    for name in ("nyuv2", "yolox-nano", "occupancy", "clip-rn50", "tu2020", "mlp5", "demo"):
        assert f"  {name} " in listed


def test_list_datasets_shows_their_options():
    listed = run("list", "datasets").stdout
    assert "depth_unit=...: unit of the depth files: m, cm, mm, or m/N" in listed
    assert "test_last=0: frames at the end of each sequence" in listed
