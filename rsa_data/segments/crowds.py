"""COCO's crowds: one region of many things of a class, which is neither one thing nor countable."""

from functools import cache
from typing import Any

import numpy as np

from ..common.class_names import ClassTable
from ..common.errors import unknown

CHOICES = ("omit", "stuff")


def sort_out(
    entries: list[dict[str, Any]], table: ClassTable, crowd: str
) -> tuple[list[dict[str, Any]], list[str], np.ndarray]:
    """Entries with category_id and iscrowd, their labels, and whether each is a thing, bool (n,).

    crowd : omit leaves crowds out; stuff keeps them as "crowd of people" and "group of books",
        which are not countable.
    """
    if crowd not in CHOICES:
        raise unknown("crowd", crowd, CHOICES)
    kept = [e for e in entries if crowd == "stuff" or not e.get("iscrowd")]
    names = [table.label(e["category_id"]) for e in kept]
    labels = [
        of_many(name) if e.get("iscrowd") else name for e, name in zip(kept, names, strict=True)
    ]
    things = [e["category_id"] in table.things and not e.get("iscrowd") for e in kept]
    return kept, labels, np.array(things, bool)


@cache
def of_many(name: str) -> str:
    """`crowd of people`, `group of oranges`."""
    import inflect

    plural = inflect.engine().plural_noun(name) or name
    return f"crowd of {plural}" if name == "person" else f"group of {plural}"
