"""Commands from signatures; old spellings of options in every command that has some."""

from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from painting import paint

from rsa_data.cli.main import cli, load, names
from rsa_data.cli.options import Number, click_options, current_words
from rsa_data.common.errors import UsageError
from rsa_data.common.options import RENAMED, flag
from rsa_data.datasets.index import open_dataset
from rsa_data.runner import stages


def test_a_command_from_a_signature():
    @click.command()
    @click_options(paint)
    def command(**given):
        click.echo(repr(paint(**given)))

    run = CliRunner().invoke
    assert run(command, []).output == "('red', 2, None, None, False)\n"
    given = ["--colour", "blue", "--share", "0.5", "--file", "x", "--dry"]
    assert run(command, given).output == f"('blue', 2, 0.5, {Path('x')!r}, True)\n"
    assert "How many times it is painted." in run(command, ["--help"]).output


def _numeric() -> list[tuple[str, click.Option]]:
    """Every option of every command that takes a number, with the command's name."""
    return [
        (name, option)
        for name in names()
        for option in load(name).params
        if isinstance(option, click.Option)
        and (isinstance(option.type, Number) or option.type.name in ("integer", "float"))
    ]


def _refusal(name: str, option: click.Option, value: str) -> str:
    """What a command says of a value of one option."""
    needed = [word for p in load(name).params if p.required for word in (p.opts[0], "x")]
    words = [*needed, option.opts[0], value]
    with pytest.raises(click.BadParameter) as caught:
        load(name).make_context(name, words)
    return caught.value.format_message()


# Options for which 0 says something of its own, such as no limit.
ZERO = {
    "--seed", "--max-tokens", "--digits", "--delete", "--delete-by-area", "--replace", "--insert",
    "--rate", "--score-threshold", "--end-lr", "--warmup", "--weight-decay", "--clip", "--patience",
    "--checkpoint-every", "train-head --pixels", "--draws", "--smooth", "--recompute",
}  # fmt: skip


def test_every_number_out_of_its_range_is_refused_with_option_expected_and_found():
    found = _numeric()
    assert len(found) > 50
    for name, option in found:
        assert isinstance(option.type, Number), f"{name} {option.opts[0]} has no range"
        flag_, bad = option.opts[0], ["-1", "nan", "inf", "1" * 30, "x", "1" * 5000]
        if option.type.kind is float:
            bad = ["-1", "nan", "-inf", "inf", "x"]
        for value in bad + ["0"] * ZERO.isdisjoint({flag_, f"{name} {flag_}"}):
            said = _refusal(name, option, value)
            shown = f"found {value!r:.60}"
            assert flag_ in said and "expected" in said and shown in said, (name, said)


def test_pipeline_files_and_dataset_options_keep_to_the_same_ranges():
    with pytest.raises(UsageError, match="embed: threads: expected a whole number, 1 to 1,024; f"):
        stages.bind("embed", {"threads": 0})
    with pytest.raises(UsageError, match=r"captions: delete: expected a number, 0 to 1; found '2'"):
        stages.bind("captions", {"delete": "2"})
    with pytest.raises(UsageError, match="part_size: expected a whole number, 1 or more; found 0"):
        open_dataset("folder:own", {"part_size": 0})
    assert stages.bind("captions", {"delete": 0, "variants": "3"}).options["variants"] == 3


OLD = [(command, old, new) for command in RENAMED for old, new in RENAMED[command].items()]


@pytest.mark.parametrize(("name", "old", "new"), OLD)
def test_an_old_spelling_is_taken_and_hidden(name, old, new, capsys):
    context = click.Context(cli, info_name="rsa-data")
    needed = [word for p in load(name).params if p.required for word in (p.opts[0], "x")]
    for words in ([flag(old), "place"], [f"{flag(old)}=place"]):
        _, command, rest = cli.resolve_command(context, [name, *needed, *words])
        given = command.make_context(name, rest, parent=context).params
        (taken,) = [p.name for p in command.params if flag(new) in p.opts]
        assert str(given[taken]) == "place"
        assert capsys.readouterr().err == f"warning: {flag(old)} is now {flag(new)}\n"
    assert f"{flag(old)} " not in CliRunner().invoke(cli, [name, "--help"]).output


def test_both_spellings_at_once_are_refused():
    with pytest.raises(click.UsageError, match="--segments is given twice"):
        current_words("detect", ["--segments", "a", "--source", "b"])


def test_words_after_two_dashes_are_left():
    assert current_words("detect", ["--", "--source"]) == ["--", "--source"]
