"""Class names: the tables that models and label maps index, and the names that captions use."""

import re
import tomllib
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import forms
from .errors import RsaDataError, unknown

if TYPE_CHECKING:
    import numpy as np

_FORM = {"first?": "a class number", "count?": "a class number"}
_GLOSS = re.compile(r"\([^()]*\)")
_TABLES = Path(__file__).parent / "class_tables.toml"


@dataclass(frozen=True)
class ClassTable:
    """What the class numbers of a model, an annotation file or a label map mean.

    names : class number -> name as captions use it.
    things : class numbers of countable things; the others are stuff.
    count : classes that a model with this table answers, named or not.
    """

    names: dict[int, str]
    things: frozenset[int]
    count: int

    def label(self, number: int) -> str:
        """The name of a class number, or "class 17" where the table has none."""
        return self.names.get(number, f"class {number}")


@cache
def clean(name: str) -> str:
    """A class name as captions write it: plain words, whatever dataset it comes from.

    COCO's merged and stuff classes lose what follows their noun ("wall-brick" is wall,
    "food-other-merged" is food); any other hyphen stays ("T-shirt"). Underscores become spaces,
    glosses in parentheses go ("speaker_(stereo_equipment)" is speaker) or become words where LVIS
    tells two classes apart by them ("bow_(weapon)" is archery bow), the first of several names
    stays ("building;edifice" is building), and COCO's word stands where other datasets have another
    ("diningtable" is dining table, "sofa" is couch). What has neither letter nor digit becomes
    "object".
    """
    text = name.replace("_", " ")
    text = str(_tables()["glossed"].get(text.strip(), text))
    while (shorter := _GLOSS.sub(" ", text)) != text:
        text = shorter
    text = re.split(r"[,;]", text.split("(")[0].strip(" ,;"))[0]
    # No reader sees control characters, and signs at the ends would run into those between phrases.
    text = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    begin, end = 0, len(text)
    while begin < end and _is_sign(text[begin]):
        begin += 1
    while begin < end and _is_sign(text[end - 1]):
        end -= 1
    text = text[begin:end] or "object"
    if text in _coco_compounds():
        text = text.partition("-")[0]
    return str(_tables()["synonyms"].get(text, text))


def _is_sign(character: str) -> bool:
    return unicodedata.category(character)[0] in "PSZ"


@cache
def _coco_compounds() -> frozenset[str]:
    """The names of COCO panoptic and COCO-Stuff that have a hyphen after the class's noun."""
    tables = _tables()
    panoptic = tables["tables"]["coco-panoptic"]["names"].values()
    return frozenset(name for name in (*panoptic, *tables["coco_stuff"]) if "-" in name)


@cache
def table(name: str) -> ClassTable:
    """One of the tables that the package ships; raises UsageError for an unknown name."""
    tables = _tables()["tables"]
    if name not in tables:
        raise unknown("class table", name, tables)
    return parse(tables[name], f"class table {name}")


def known() -> list[str]:
    """The names of the tables that the package ships."""
    return sorted(_tables()["tables"])


def every() -> dict[str, str]:
    """Every name of the shipped tables, other datasets' words too -> the name in captions."""
    tables = _tables()
    synonyms: dict[str, str] = tables["synonyms"]
    found = {name: name for table_name in known() for name in table(table_name).names.values()}
    found |= {name: clean(name) for name in tables["coco_stuff"]}
    return {name: name for name in found.values()} | synonyms


def described() -> list[tuple[str, str]]:
    """(name, how many classes and the first of them) of every shipped table."""
    found = ((name, list(table(name).names.values())) for name in known())
    return [(name, f"{len(names)} classes: {', '.join(names[:5])}, ...") for name, names in found]


def parse(spec: dict[str, Any], where: str) -> ClassTable:
    """A table from its TOML form: `names`, a list counted from `first` (0 unless given) or a table
    of number = name; `things`, the names of the countable ones, or "all" or "none"; `count`, where
    a model answers more classes than have a name.

    A name "" is no class (background). Raises RsaDataError when it is not of that form.
    """
    forms.check(spec, _FORM, where)
    names = spec.get("names")
    if isinstance(names, list):
        first = spec.get("first", 0)
        numbers = dict(enumerate(names, first))
    elif isinstance(names, dict) and all(n.isdecimal() and len(n) < 10 for n in names):
        numbers = {int(number): name for number, name in names.items()}
    else:
        raise RsaDataError(
            f'{where}: expected names = ["a", ...] or a table of number = name; found {names!r}'
        )
    forms.check(list(numbers.values()), ["a name of at most 1,000 letters"], f"{where}: names")
    things = spec.get("things", "all")
    if things == "all":
        countable = frozenset(numbers)
    elif things == "none":
        countable = frozenset()
    elif strange := set(forms.check(things, ["text"], f"{where}: things")) - {*numbers.values()}:
        raise RsaDataError(f"{where}: things not among the names: {', '.join(sorted(strange))}")
    else:
        countable = frozenset(n for n, name in numbers.items() if name in things)
    count = spec.get("count", max(numbers, default=-1) + 1)
    plain = {n: clean(name) for n, name in numbers.items() if name}
    return ClassTable(plain, countable, count)


def things(labels: Sequence[str]) -> "np.ndarray":
    """Which of some caption names are things, by the COCO panoptic classes; unknown ones are.

    Returns bool of shape (n,).
    """
    import numpy as np

    stuff = _coco_stuff()
    return np.fromiter((label not in stuff for label in labels), bool, len(labels))


@cache
def _coco_stuff() -> frozenset[str]:
    coco = table("coco-panoptic")
    return frozenset(name for n, name in coco.names.items() if n not in coco.things)


@cache
def _tables() -> dict[str, Any]:
    return tomllib.loads(_TABLES.read_text("utf-8"))
