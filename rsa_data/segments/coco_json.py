"""COCO's JSON: read and checked before anything is made of it."""

from collections import Counter
from pathlib import Path
from typing import Any

from ..common import bounded, forms
from ..common.class_names import ClassTable, clean
from ..common.errors import RsaDataError
from ..datasets.partners import some

IMAGE = {"id": "a number or text", "file_name": "a path"}
IMAGE |= {"width?": "a size in px", "height?": "a size in px"}
CATEGORY = {"id": "a whole number", "name": "a name of at most 1,000 letters"}
PANOPTIC = {"image_id": "a number or text", "file_name": "a path", "segments_info": "a list"}
SEGMENT = {"id": "a whole number", "category_id": "a whole number", "area?": "a number"}
SEGMENT |= {"iscrowd?": "0 or 1"}
RESULT = {"image_id": "a number or text", "category_id": "a whole number", "score?": "a number"}
RESULT |= {"bbox?": "a list of numbers", "iscrowd?": "0 or 1", "ignore?": "0 or 1"}


def images(content: Any, where: str) -> list[dict[str, Any]]:
    """The images of a file, checked; LVIS names them by coco_url instead of file_name."""
    listed: list[Any] = content if isinstance(content, list) else [content]
    named = [
        image | {"file_name": "/".join(image["coco_url"].split("/")[-2:])}
        if isinstance(image, dict)
        and "file_name" not in image
        and isinstance(image.get("coco_url"), str)
        else image
        for image in listed
    ]
    return check(named if isinstance(content, list) else content, IMAGE, where)


def load(path: Path, where: str) -> Any:
    """The content of a JSON file; RsaDataError when it is none."""
    try:
        return bounded.read_json(path)
    except (OSError, ValueError) as error:
        raise RsaDataError(f"{where}: expected a JSON file at {path}; found: {error}") from error


def check(items: Any, wanted: dict[str, str], where: str) -> list[dict[str, Any]]:
    """The list itself, if it is one of objects of that form; see forms.check."""
    found: list[dict[str, Any]] = forms.check(items, [wanted], where)
    return found


def categories(content: dict[str, Any], where: str) -> ClassTable:
    """The class table of a COCO file's categories, each id once."""
    given = check(content.get("categories"), CATEGORY, f"{where}: categories")
    once([c["id"] for c in given], f"{where}: categories: id")
    names = {c["id"]: clean(c["name"]) for c in given}
    things = frozenset(c["id"] for c in given if c.get("isthing", 1))
    return ClassTable(names, things, max(names, default=-1) + 1)


def once(values: list[Any], where: str) -> None:
    """Raises RsaDataError when a value stands twice."""
    if repeated := [value for value, count in Counter(values).items() if count > 1]:
        raise RsaDataError(f"{where}: expected each once, found several of {some(repeated)}")


def known_classes(numbers: list[int], table: ClassTable, where: str) -> None:
    """Raises RsaDataError when category ids are not in the class table."""
    strange = Counter(n for n in numbers if n not in table.names)
    if not strange:
        return
    listed, numbered = sorted(table.names), sorted(set(numbers))
    hint = ""
    for step, word in ((1, "larger"), (-1, "smaller")):
        if all(n + step in table.names for n in numbered):
            hint = f" All would be among them if they were {word} by 1."
    raise RsaDataError(
        f"{where}: expected category ids of its classes, {listed[0] if listed else 'none'} to "
        f"{listed[-1] if listed else 'none'}; found {some(sorted(strange))} in "
        f"{sum(strange.values())} of {len(numbers)} entries.{hint} Say by --names, or correct the "
        "file's categories, what the ids mean"
    )
