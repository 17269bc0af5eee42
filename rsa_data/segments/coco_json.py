"""The forms of COCO's JSON, checked before anything is made of it."""

from typing import Any

from ..common import forms

IMAGE = {"id": "a number or text", "file_name": "a path"}
IMAGE |= {"width?": "a size in px", "height?": "a size in px"}
CATEGORY = {"id": "a whole number", "name": "text"}
PANOPTIC = {"image_id": "a number or text", "file_name": "a path", "segments_info": "a list"}
SEGMENT = {"id": "a whole number", "category_id": "a whole number", "area?": "a number"}
RESULT = {"image_id": "a number or text", "category_id": "a whole number", "score?": "a number"}
RESULT |= {"bbox?": "a list of 4 numbers"}


def check(items: Any, wanted: dict[str, str], where: str) -> list[dict[str, Any]]:
    """The list itself, if it is one of objects of that form; see shape.check."""
    found: list[dict[str, Any]] = forms.check(items, [wanted], where)
    return found
