"""Options come from signatures: bound, converted, refused by name."""

from pathlib import Path
from typing import Literal

import click
import pytest
from click.testing import CliRunner

from rsa_data.common import options
from rsa_data.common.errors import UsageError


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


def test_defaults_and_conversion():
    given = {"layers": "3", "share": 1, "file": "a.png", "dry": "true"}
    assert options.bind(paint, given, "job") == {
        "colour": "red",
        "layers": 3,
        "share": 1.0,
        "file": Path("a.png"),
        "dry": True,
    }


def test_a_dash_is_an_underscore():
    def f(*, part_size: int = 1): ...

    assert options.bind(f, {"part-size": 2}, "job") == {"part_size": 2}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"layer": 3}, r"job: unknown option 'layer'. Did you mean 'layers'\?"),
        ({"layers": "three"}, "job: layers: expected int, found 'three'"),
        ({"layers": True}, "job: layers: expected int, found True"),
        ({"colour": "green"}, "job: colour: expected"),
    ],
    ids=["unknown", "not a number", "bool is no int", "no choice"],
)
def test_bad_options_are_refused(given, message):
    with pytest.raises(UsageError, match=message):
        options.bind(paint, given, "job")


def test_a_missing_option_is_named():
    def f(*, model: str): ...

    with pytest.raises(UsageError, match="job: the option model is missing"):
        options.bind(f, {}, "job")


def test_help_is_the_first_sentence():
    assert options.help_text(paint, "colour") == "what it looks like"
    assert options.help_text(paint, "layers") == "how many times it is painted"
    assert options.help_text(paint, "dry") == ""


def test_a_command_from_a_signature():
    @click.command()
    @options.click_options(paint)
    def command(**given):
        click.echo(repr(paint(**given)))

    run = CliRunner().invoke
    assert run(command, []).output == "('red', 2, None, None, False)\n"
    given = ["--colour", "blue", "--share", "0.5", "--file", "x", "--dry"]
    assert run(command, given).output == f"('blue', 2, 0.5, {Path('x')!r}, True)\n"
    assert "How many times it is painted." in run(command, ["--help"]).output


def test_a_whole_number_that_no_float_can_hold_is_refused():
    def build(*, rate: float = 0.0) -> None:
        """rate : how fast."""

    assert options.bind(build, {"rate": 3}, "x") == {"rate": 3.0}
    with pytest.raises(UsageError, match="x: rate: expected float, found 1000"):
        options.bind(build, {"rate": 10**400}, "x")
