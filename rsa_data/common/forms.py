"""Checks of JSON and TOML that others wrote, before anything is made of it: what is wrong, where.

A form is a kind by the words that its error uses (`KINDS`), a list of one form for a list of such,
or a dict for an object: key -> form, where `?` ends keys that may be missing and "*" stands for
every other key. Keys that are not named may be there.
"""

import os
from collections.abc import Callable
from pathlib import PurePosixPath
from typing import Any

from .errors import RsaDataError

# Beyond this a float is no whole number any more, and NumPy's integers are near their end.
_LARGEST = 2**53


def _whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < _LARGEST


def _number(value: Any) -> bool:
    return _whole(value) or (isinstance(value, float) and abs(value) < _LARGEST)


def is_text(value: Any) -> bool:
    """Whether a value is a string that UTF-8 can hold; JSON can spell others (lone surrogates)."""
    return isinstance(value, str) and not any("\ud800" <= c <= "\udfff" for c in value)


def is_path(text: str) -> bool:
    """Whether a file system could have such a path: names of at most 255 bytes, no NUL."""
    path = PurePosixPath(text)
    try:
        sizes = [len(os.fsencode(part)) for part in path.parts]
    except UnicodeEncodeError:
        return False
    short = max(sizes, default=0) <= 255 and sum(sizes) + len(sizes) < 3000
    return bool(path.name) and "\0" not in text and short


def _two_sides(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(KINDS["a side in px"], value))


KINDS: dict[str, Callable[[Any], bool]] = {
    "a whole number": _whole,
    "a count": lambda v: _whole(v) and v >= 0,
    "a number": _number,
    "a share from 0 to 1": lambda v: _number(v) and 0 <= v <= 1,
    "a class number": lambda v: _whole(v) and 0 <= v <= 2**20,
    "a size in px": lambda v: _whole(v) and 0 < v < 2**24,
    "a side in px": lambda v: _whole(v) and 0 < v <= 2**14,
    "a size or a number": lambda v: _number(v) and (isinstance(v, float) or 0 <= v <= 2**14),
    "two sides in px": _two_sides,
    "text or two sides in px": lambda v: is_text(v) or _two_sides(v),
    "true or false": lambda v: isinstance(v, bool),
    "0 or 1": lambda v: isinstance(v, (int, float)) and v in (0, 1),
    "text": is_text,
    "a name of at most 1,000 letters": lambda v: is_text(v) and len(v) <= 1000,
    "a path": lambda v: is_text(v) and is_path(v),
    "a path that stays below": lambda v: (
        is_text(v) and is_path(v) and not v.startswith("/") and ".." not in v.split("/")
    ),
    "a file's name": lambda v: is_text(v) and is_path(v) and "/" not in v and v != "..",
    "a number or text": lambda v: is_text(v) or _whole(v),
    "a list": lambda v: isinstance(v, list),
    "an object": lambda v: isinstance(v, dict),
    "a number or nothing": lambda v: v is None or _number(v),
    "an object or nothing": lambda v: v is None or isinstance(v, dict),
    "text or nothing": lambda v: v is None or is_text(v),
    "a list of numbers": lambda v: isinstance(v, list) and all(map(_number, v)),
    "a list of 3 numbers": lambda v: isinstance(v, list) and len(v) == 3 and all(map(_number, v)),
    "a list of 4 numbers": lambda v: isinstance(v, list) and len(v) == 4 and all(map(_number, v)),
}


def check(value: Any, form: Any, where: str) -> Any:
    """The value itself if it has that form; RsaDataError that names the first wrong place."""
    if isinstance(form, str):
        if not KINDS[form](value):
            raise RsaDataError(f"{where}: expected {form}, found {found(value)}")
    elif isinstance(form, list):
        if not isinstance(value, list):
            raise RsaDataError(f"{where}: expected a list, found {found(value)}")
        for index, item in enumerate(value):
            check(item, form[0], f"{where}[{index}]")
    else:
        if not isinstance(value, dict):
            raise RsaDataError(f"{where}: expected an object, found {found(value)}")
        named = {key.removesuffix("?") for key in form}
        for key, inner in form.items():
            name = key.removesuffix("?")
            if key == "*":
                for other in value.keys() - named:
                    check(value[other], inner, f"{where}.{other}")
            elif name in value or name == key:
                check(value.get(name), inner, f"{where}.{name}")
    return value


def found(value: Any) -> str:
    """A value in a few characters, for messages."""
    text = "nothing" if value is None else ascii(value)
    return text if len(text) <= 60 else text[:57] + "..."
