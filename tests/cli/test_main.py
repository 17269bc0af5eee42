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


@pytest.mark.parametrize("name", main.names())
def test_every_command_has_help_with_an_example(name):
    result = CliRunner().invoke(main.cli, [name, "--help"])
    assert result.exit_code == 0, result.output
    assert f"rsa-data {name}" in result.output
    assert main.load(name).help.partition("\n")[0] == main.short_help(name)


def test_help_loads_no_command():
    code = (
        "import sys, time; from rsa_data.cli.main import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'pyarrow', 'torch', 'pandas', 'onnxruntime'} & set(sys.modules)\n"
        "print(heavy or 'light', time.process_time())"
    )
    words = [sys.executable, "-c", code, "--help"]
    last = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()[-1]
    word, seconds = last.split()
    assert word == "light" and float(seconds) < 0.4


def test_the_package_shows_its_public_names_only():
    import rsa_data

    assert dir(rsa_data) == sorted(rsa_data.__all__)


def test_old_spellings_in_a_pipeline_file_and_in_its_changes(tmp_path):
    """The old names bind; the file is then refused for what it lacks, not for the names."""
    file = tmp_path / "old.toml"
    file.write_text(
        "[dataset.synthetic-indoor]\n[dataset.synthetic-indoor.depth]\n"
        'depth_model = "tu2020"\nweights = "d.onnx"\n'
        '[detect]\nsource = "yolox-nano"\n[captions]\n[embed]\nencoder = "minilm"\n'
    )
    changes = ["detect.model=y.onnx", "detect.source=fastestdet", "embed.weights=w"]
    words = [word for change in changes for word in ("--set", change)]
    ended = run("plan", "run", str(file), *words, "--set", "captions.stile=x", cwd=tmp_path)
    warnings = [line for line in ended.stderr.splitlines() if line.startswith("warning: ")]
    assert sorted(warnings) == [
        "warning: --model is now --segmenter-weights",
        "warning: --source is now --segments",
        "warning: --weights is now --depth-weights",
        "warning: --weights is now --encoder-weights",
    ]
    assert ended.returncode == 2 and "Did you mean 'style'?" in ended.stderr


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (["caption"], 2, "Did you mean 'captions'?"),
        (["captions"], 2, "--dataset"),
        (["captions", "--dataset", "nyuv"], 2, "Did you mean 'nyuv2'?"),
        (["captions", "--dataset", "nyuv2"], 1, "rsa-data list datasets nyuv2"),
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


@pytest.mark.parametrize("name", ["nyuv2", "synthetic-street", "folder"])
def test_list_datasets_shows_the_page_of_one(name):
    done = run("list", "datasets", name)
    assert done.returncode == 0
    assert "    " in done.stdout and "options (--dataset-option NAME=VALUE):" in done.stdout
    assert run("list", "datasets", "nyu").returncode == 2
