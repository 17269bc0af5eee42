"""Class names as English: cleaned, with their article and their plural."""

import re
from dataclasses import dataclass
from functools import cache


@dataclass(frozen=True)
class Word:
    """name : the class as it stands in a text; plural : of several; article : "a ", "an " or "";
    is_plural : the name itself is plural (stairs, scissors)."""

    name: str
    plural: str
    article: str
    is_plural: bool

    @property
    def verb_s(self) -> str:
        """The ending of a verb that follows the name: "s" (a bed occupies) or "" (stairs occupy)."""
        return "" if self.is_plural else "s"


def clean(label: str) -> str:
    label = re.sub(r"\([^()]*\)", " ", label.replace("_", " "))
    return " ".join(label.split()) or "object"


@cache
def word(label: str) -> Word:
    name = clean(label)
    return Word(name, name + "s", "a ", False)
