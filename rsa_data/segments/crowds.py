"""COCO's crowds: one region of many things of a class, which is neither one thing nor countable."""

from functools import cache
from typing import Any

import numpy as np

from ..common.class_names import ClassTable
from ..common.english import engine
from ..common.errors import RsaDataError, unknown

CHOICES = ("omit", "stuff")


def sort_out(
    entries: list[dict[str, Any]], table: ClassTable, crowd: str
) -> tuple[list[dict[str, Any]], list[str], np.ndarray]:
    """Entries with category_id and iscrowd, their labels, and whether each is a thing, bool (n,).

    crowd : omit leaves crowds out; stuff keeps them as "crowd of people" and "group of books",
        which are not countable. Regions to ignore (`"ignore": 1`) are left out in both cases.
    """
    if crowd not in CHOICES:
        raise unknown("crowd", crowd, CHOICES)
    entries = [e for e in entries if not e.get("ignore")]
    kept = [e for e in entries if crowd == "stuff" or not e.get("iscrowd")]
    names = [table.label(e["category_id"]) for e in kept]
    labels = [
        of_many(name) if e.get("iscrowd") else name for e, name in zip(kept, names, strict=True)
    ]
    things = [e["category_id"] in table.things and not e.get("iscrowd") for e in kept]
    return kept, labels, np.array(things, bool)


def require_some_single(entries: list[dict[str, Any]], crowd: str, where: str) -> None:
    """Raises RsaDataError when every entry of a file is a crowd that would be left out."""
    if crowd == "omit" and entries and all(e.get("iscrowd") for e in entries):
        raise RsaDataError(
            f"{where}: expected single objects; found iscrowd 1 in all {len(entries):,} entries, "
            "as annotation tools write it beside run lengths. Set it to 0 where an entry is "
            "one object, or keep them as groups with --crowd stuff"
        )


@cache
def of_many(name: str) -> str:
    """`crowd of people`, `group of oranges`."""
    plural = engine().plural_noun(name) or name
    return f"crowd of {plural}" if name == "person" else f"group of {plural}"
