"""Typed structures (msgspec.Struct) from JSON that others wrote: what is wrong, and where.

A structure is defined once, by its class: its fields are its form. `parse` reads one,
`encoding.to_json` prints it. What types cannot say, `__post_init__` checks, and raises ValueError.
"""

import re
from typing import Annotated, Any, TypeVar

import msgspec

from .errors import RsaDataError
from .forms import found

T = TypeVar("T")

# Beyond 2**53 a float is no whole number any more, and NumPy's integers are near their end.
Count = Annotated[int, msgspec.Meta(ge=0, lt=2**53)]

_KINDS = {
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "float": "a number",
    "object": "an object",
    "array": "a list",
    "null": "nothing",
}
_MESSAGE = re.compile(r"(.*?)(?: - at `\$(.*)`)?", re.DOTALL)


def parse(data: bytes, kind: type[T], where: str) -> T:
    """The structure that JSON holds. Raises RsaDataError: where, expected, found."""
    try:
        value = msgspec.json.decode(data)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise RsaDataError(f"{where}: expected JSON, found {data!r:.60}") from error
    return convert(value, kind, where)


def convert(value: Any, kind: type[T], where: str) -> T:
    """The structure that plain values (of JSON, TOML) make. Raises RsaDataError, see `parse`."""
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        raise RsaDataError(_explained(str(error), value, where)) from error


def _explained(message: str, value: Any, where: str) -> str:
    match = _MESSAGE.fullmatch(message)
    text, path = match.groups() if match else (message, None)
    place = where + (path or "").replace("[...]", "")
    names = re.findall(r"`(.*?)`", text)
    if text.startswith("Object missing required field"):
        return f"{place}: expected {names[0]}, found nothing"
    if text.startswith("Object contains unknown field"):
        return f"{place}: expected no {names[0]}: another version of rsa-data may know it"
    if not text.startswith("Expected "):
        return f"{place}: {text}"
    wanted = text.removeprefix("Expected ").partition(", got ")[0]
    wanted = re.sub(r"`(.+?)`", lambda kinds: _named(kinds[1]), wanted)
    return f"{place}: expected {wanted}, found {found(_at(value, path or ''))}"


def _named(kinds: str) -> str:
    """`str | null` as "text or nothing"."""
    return " or ".join(_KINDS.get(kind, kind) for kind in kinds.split(" | "))


def _at(value: Any, path: str) -> Any:
    """What stands at a path such as .parts[3].file; the whole of what `[...]` goes through."""
    for key, index in re.findall(r"\.([^.\[]+)|\[(\d+)\]", path.partition("[...]")[0]):
        value = value[key] if key else value[int(index)]
    return value
