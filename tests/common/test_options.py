"""Options come from signatures: bound, converted, refused by name."""

from dataclasses import dataclass
from pathlib import Path

import pytest
from painting import paint

from rsa_data.common import options
from rsa_data.common.errors import UsageError


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


def test_a_whole_number_that_no_float_can_hold_is_refused():
    def build(*, rate: float = 0.0) -> None:
        """rate : how fast."""

    assert options.bind(build, {"rate": 3}, "x") == {"rate": 3.0}
    with pytest.raises(UsageError, match="x: rate: expected float, found 1000"):
        options.bind(build, {"rate": 10**400}, "x")


@dataclass(frozen=True)
class Brush:
    """What it is painted with.

    width : of the brush, cm.
    """

    width: float = 5.0
    hair: str | None = None


def varnish(*, coats: int = 1, brush: Brush = Brush()):
    """coats : how often."""
    return coats, brush


def test_fields_of_a_group_are_options():
    assert list(options.parameters(varnish)) == ["coats", "width", "hair"]
    assert options.help_text(varnish, "width") == "of the brush, cm"
    bound = options.bind(varnish, {"width": "7", "coats": 2}, "job")
    assert bound == {"coats": 2, "width": 7.0, "hair": None}
    assert options.call(varnish, **bound) == (2, Brush(7.0))


@pytest.mark.parametrize("name", ["source", "model", "model_card"])
def test_old_names_are_taken_with_a_warning(name):
    @options.accepts_old_names("detect")
    def detect(*, segments: str = "s", segmenter_weights: str = "w", card: str = "c"):
        return {"source": segments, "model": segmenter_weights, "model_card": card}[name]

    new = options.RENAMED["detect"][name]
    with pytest.warns(options.RenamedOption, match=f"^{options.flag(name)} is now "):
        assert detect(**{name: "x"}) == "x"
    with pytest.warns(options.RenamedOption):
        bound = options.bind(detect, {name: "x"}, "detect")
    assert bound[new] == "x" and len(bound) == 3
    assert options.stored(detect, bound)[name] == "x"
    with pytest.raises(UsageError, match="given twice"):
        detect(**{new: 1, name: 2})
