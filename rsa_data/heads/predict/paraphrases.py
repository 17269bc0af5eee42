"""A caption with its objects in other orders, by which a prediction's spread is measured."""

import random
import re
from typing import TYPE_CHECKING, Any

from ... import registry

if TYPE_CHECKING:
    from ...captions.wordings.wording import Wording

_PARAPHRASES = 8
_SIGNS = re.compile(r", and |, | and ")


def paraphrases(caption: str, wording: "Wording | None" = None) -> list[str] | None:
    """The caption with its objects in other orders: up to 8 texts, the same every time.

    wording : of the caption, where that is known. What stands behind its opening, between its
    signs, is an object. In any other text it is what stands after the first "with" and between
    commas and "and". A caption of one object has no paraphrases; None where a caption has several
    parts and neither rule shows which of them are objects.
    """
    found = _of_wording(caption, wording) if wording else None
    if found is None and (wording is None or isinstance(wording.opening, str)):
        found = _of_any(caption)
    if found is None:
        return None if _SIGNS.search(caption) else []
    before, objects, between, last, closing = found
    texts: list[str] = []
    for seed in range(3 * _PARAPHRASES if len(objects) > 1 else 0):
        random.Random(seed).shuffle(objects)
        text = f"{before}{between.join(objects[:-1])}{last}{objects[-1]}{closing}"
        if text != caption and text not in texts:
            texts.append(text)
    return texts[:_PARAPHRASES]


def wording_of(about: dict[str, Any], style: str | None = None) -> "Wording | None":
    """The wording of a head's training captions, or of a style chosen instead; None for others.

    about : head.json. A style that nobody named here is not imported.
    """
    from ...captions.wordings.wording import Wording

    options: dict[str, Any] = next(iter((about.get("captions") or {}).values()), {})
    style = style or options.get("style") or ""
    if style not in registry.STYLES:
        return None
    found = registry.resolve("style", registry.STYLES, style)
    return found if isinstance(found, Wording) else None


def _of_wording(caption: str, wording: "Wording") -> tuple[str, list[str], str, str, str] | None:
    """What stands before the objects, the objects, the signs between them, and the end."""
    opening, closing = wording.opening, wording.closing
    if not isinstance(opening, str) or not opening or not caption.startswith(opening):
        return None
    if not caption.endswith(closing):
        return None
    body = caption[len(opening) : len(caption) - len(closing)]
    # The longer sign first: ", and " begins with ", ".
    signs = sorted({wording.between, wording.last}, key=len, reverse=True)
    objects = re.split("|".join(map(re.escape, signs)), body)
    if len(objects) < 2:
        return None
    return opening, objects, wording.between, wording.last, closing


def _of_any(caption: str) -> tuple[str, list[str], str, str, str] | None:
    if match := re.fullmatch(r"(.*?\bwith )(.+?)(\.?)", caption, re.DOTALL):
        return match[1], _SIGNS.split(match[2]), ", ", ", ", match[3]
    return None
