"""The objects that a caption names, for heads that read objects instead of sentences."""

import re
from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

from ...common import class_names
from ..inputs.scene import Thing

_WITH = re.compile(r"\bwith\b", re.IGNORECASE)
# Between the objects of a list; the point in a share is no sign.
_SIGNS = re.compile(r"[,;]|\.(?![0-9])|\band\b|\bwith\b", re.IGNORECASE)
_BEFORE = re.compile(
    r"^(?:(?:an?|the|some|this|it|there|is|are|of|photo|picture|image|shows?|pairs?|pieces?)"
    r"(?:\s+|$))+",
    re.IGNORECASE,
)
_SHARE = re.compile(r"([0-9]+(?:\.[0-9]+)?)\s?%")
# What stands behind these in a phrase is not in the picture ("no chairs", "without windows").
_NOT = re.compile(r"\b(?:no|not|without|zero|neither|nor|never)\b", re.IGNORECASE)
# A phrase with one of these words is not the name of a thing.
_NO_NAME = re.compile(
    r"\b(?:nothing|something|anything|everything|none|nobody|nowhere|empty|here|there|this|that)\b",
    re.IGNORECASE,
)
_MOST_WORDS = 3  # of a name that is in no table
_LONGEST_COUNT = 40  # characters of a word for a count, with the spaces behind it
_MOST_OBJECTS = 50  # of one count


class Read(NamedTuple):
    """What was read of a caption.

    things : its objects. rest : phrases in which no object was found. strange : names among the
    things that no class table has.
    """

    things: tuple[Thing, ...]
    rest: tuple[str, ...]
    strange: tuple[str, ...] = ()

    @property
    def notes(self) -> list[str]:
        """What was read, in words."""
        said = [f"objects read: {text_of(self.things) or 'none'}"]
        if self.strange:
            names = ", ".join(self.strange)
            said.append(f"in no class table, taken for the name of an object: {names}")
        return said + ([f"not read as objects: {'; '.join(self.rest)}"] if self.rest else [])


def objects_in(caption: str) -> Read:
    """The objects that a caption names, in its order, with their counts and their shares.

    Names are those of the class tables that the package ships, singular or plural, anywhere in the
    text; and in a list ("desk, office chair and lamp") any name of up to three words. A count ("two
    chairs", "2 chairs") stands for so many objects; a share ("bed 13%", "2 chairs occupy 8.00% of
    the image") is divided among them. What stands behind "no" or "without" in its phrase is not
    read.
    """
    found: list[Thing] = []
    rest: list[str] = []
    strange: list[str] = []
    # What stands before "with" describes the place: a name in it must be a known one.
    place, *behind = _WITH.split(caption, maxsplit=1)
    listed = [(phrase, True) for phrase in _SIGNS.split(behind[0] if behind else place)]
    described = [(phrase, False) for phrase in _SIGNS.split(place)] if behind else []
    for phrase, in_list in (*described, *listed):
        text = _BEFORE.sub("", phrase.strip()).strip()
        denied = _NOT.search(phrase)
        named = list(_named(phrase[: denied.start()] if denied else phrase))
        if not named and in_list and not denied and _reads_like_a_name(text):
            named = [(class_names.clean(_SHARE.sub("", text)), 1)]
            strange += [named[0][0]]
        elif denied and named:
            rest.append(phrase[denied.start() :].strip())
        if not named:
            rest += [text] if text else []
            continue
        share = _SHARE.search(phrase)
        # The share of a phrase is that of its only name.
        part = float(share[1]) / 100 if share and len(named) == 1 else None
        for name, count in named:
            each = None if part is None or part > 1 else part / count
            found += [Thing(name, each, None, bool(class_names.things([name])[0]))] * count
    return Read(tuple(found), tuple(rest), tuple(dict.fromkeys(strange)))


def text_of(things: Sequence[Thing]) -> str:
    """Objects as a list that `objects_in` reads again: `bed 13.4%, chair 2.0%`."""
    return ", ".join(
        thing.name if thing.share is None else f"{thing.name} {thing.share:.1%}" for thing in things
    )


def _named(phrase: str) -> Iterator[tuple[str, int]]:
    """The known names in a phrase, each with its count."""
    pattern, names, counts = _known()
    for match in pattern.finditer(phrase):
        name, plural = names[match[0].lower()]
        # The word before it: all that stands there would take the square of the phrase's length.
        before = phrase[max(0, match.start() - _LONGEST_COUNT) : match.start()].split()
        number = before[-1].lower() if before else ""
        digits = int(number) if number.isdecimal() and len(number) < 4 else 0
        count = counts.get(number) or digits or (2 if plural else 1)
        yield name, min(count, _MOST_OBJECTS)


def _reads_like_a_name(text: str) -> bool:
    words = _SHARE.sub("", text).split()
    if _NO_NAME.search(text):
        return False
    return 0 < len(words) <= _MOST_WORDS and any(c.isalpha() for word in words for c in word)


@cache
def _known() -> tuple[re.Pattern[str], dict[str, tuple[str, bool]], dict[str, int]]:
    """A pattern of all names, longest first; what each stands for; and the words for counts."""
    from ...captions.words import number_word, word

    names: dict[str, tuple[str, bool]] = {}
    every = class_names.every()
    for written, name in every.items():
        names.setdefault(word(written).plural.lower(), (name, not word(written).is_plural))
        # `word` knows the name in captions only: sofas.
        names.setdefault(f"{written.lower()}s", (name, True))
    # A name wins over another one's plural: glasses.
    names |= {written.lower(): (name, False) for written, name in every.items()}
    longest_first = sorted(names, key=len, reverse=True)
    pattern = rf"\b(?:{'|'.join(map(re.escape, longest_first))})\b"
    counts = {number_word(n): n for n in range(1, 21)}
    return re.compile(pattern, re.IGNORECASE), names, counts
