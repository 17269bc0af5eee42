"""Checks of COCO's JSON before anything is made of it: what is wrong, and where it stands."""

from collections.abc import Callable, Mapping
from typing import Any

from ..errors import RsaDataError

# Beyond this a float is no whole number any more, and NumPy's integers are near their end.
_LARGEST = 2**53

# A check by the words that its error uses.
_KINDS: dict[str, Callable[[Any], bool]] = {
    "a whole number": lambda v: isinstance(v, int) and abs(v) < _LARGEST,
    "a number": lambda v: isinstance(v, (int, float)) and abs(v) < _LARGEST,
    "a size in px": lambda v: isinstance(v, int) and 0 < v < 2**24,
    "text": lambda v: isinstance(v, str),
    "a number or text": lambda v: isinstance(v, str) or (isinstance(v, int) and abs(v) < _LARGEST),
    "a list": lambda v: isinstance(v, list),
    "a list of 4 numbers": lambda v: (
        isinstance(v, list) and len(v) == 4 and all(_KINDS["a number"](x) for x in v)
    ),
}

IMAGE = {"id": "a number or text", "file_name": "text", "width?": "a size in px"}
IMAGE |= {"height?": "a size in px"}
CATEGORY = {"id": "a whole number", "name": "text"}
PANOPTIC = {"image_id": "a number or text", "file_name": "text", "segments_info": "a list"}
SEGMENT = {"id": "a whole number", "category_id": "a whole number", "area?": "a number"}
RESULT = {"image_id": "a number or text", "category_id": "a whole number", "score?": "a number"}
RESULT |= {"bbox?": "a list of 4 numbers"}


def check(items: Any, wanted: Mapping[str, str], where: str) -> list[dict[str, Any]]:
    """The list itself, if it is one of objects with the keys `wanted`; `?` ends optional ones.

    Raises RsaDataError that names the first place where it is not.
    """
    if not isinstance(items, list):
        raise RsaDataError(f"{where}: expected a list, found {_short(items)}")
    for index, item in enumerate(items):
        if not isinstance(item, dict):
            raise RsaDataError(f"{where}[{index}]: expected an object, found {_short(item)}")
        for key, kind in wanted.items():
            name = key.removesuffix("?")
            if name not in item and key.endswith("?"):
                continue
            if not _KINDS[kind](item.get(name)):
                raise RsaDataError(
                    f"{where}[{index}].{name}: expected {kind}, found {_short(item.get(name))}"
                )
    return items


def _short(value: Any) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
