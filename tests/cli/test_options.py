"""Commands from signatures; old spellings of options in every command that has some."""

from pathlib import Path
from typing import Literal

import click
import pytest
from click.testing import CliRunner

from rsa_data.cli.main import cli, load
from rsa_data.cli.options import click_options, current_words
from rsa_data.common.options import RENAMED, flag


def paint(
    *,
    colour: Literal["red", "blue"] = "red",
    layers: int = 2,
    share: float | None = None,
    file: Path | None = None,
    dry: bool = False,
):
    """Paints.

    Parameters
    ----------
    colour : what it looks like; more is not said.
    layers : how many times
        it is painted. Twice will do.
    share : of the wall.
    """
    return colour, layers, share, file, dry


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
