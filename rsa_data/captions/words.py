"""Class names as English words: cleaned, with their article and their plural."""

from collections.abc import Container
from dataclasses import dataclass
from functools import cache

from ..common.class_names import clean
from ..common.english import engine
from .noun_exceptions import MASS, PAIRS, PLURAL, PLURALS


@dataclass(frozen=True)
class Word:
    """A class name in its forms.

    name : of one, without underscores and glosses, beginning and ending in a letter or digit.
    plural : of several.
    article : "a " or "an "; empty for plural and mass nouns.
    is_plural : the name itself is plural (stairs, scissors), so that a verb has no s.
    """

    name: str
    plural: str
    article: str
    is_plural: bool


# Longer names are no English nouns, and inflect's patterns are slow on them.
_LONGEST = 60


@cache
def word(label: str) -> Word:
    """The forms of a class name, whatever dataset it comes from."""
    name = clean(label)
    if known := _find(name, PLURALS):
        return Word(name, name.removesuffix(known) + PLURALS[known], _article(name), False)
    if _find(name, PAIRS):
        return Word(name, f"pairs of {name}", "", True)
    if _find(name, PLURAL):
        return Word(name, name, "", True)
    for amount, nouns in MASS.items():
        if _find(name, nouns):
            return Word(name, f"{amount} of {name}", "", name == "grits")
    # TVs, not TVS.
    other = _foreign(name) or not name[-1].islower()
    plural = name + "s" if other else str(engine().plural_noun(name))
    return Word(name, plural, _article(name), False)


@cache
def number_word(number: int) -> str:
    """two, seventeen, twenty-one."""
    return str(engine().number_to_words(number))


def _find(name: str, nouns: Container[str]) -> str | None:
    """What of a name stands in a table: all of it, its last word, or its last two."""
    parts = name.split()
    endings = (name, parts[-1], " ".join(parts[-2:]), parts[-1].lower())
    return next((ending for ending in endings if ending in nouns), None)


def _foreign(name: str) -> bool:
    return len(name) > _LONGEST or not name.isascii()


def _article(name: str) -> str:
    if _foreign(name):
        return "a "
    return str(engine().a(name)).split(" ")[0] + " "
