"""What a captions table leaves out, and which option would leave out less."""

from collections.abc import Iterable, Mapping
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from ..common.tokenizers import Tokenizer
from .styles import NOTHING

COLUMNS = ("variant", "n_objects", "n_kept", "n_tokens", "area", "area_kept")

# What else could be asked for, each tried on a part as it is.
ALTERNATIVES: tuple[dict[str, Any], ...] = (
    {"digits": 0},
    {"group": True},
    {"group": True, "digits": 0},
)


def kept(captions: Iterable[pa.Table]) -> dict[str, float]:
    """Sums over the plain captions (variant 0) of tables that have COLUMNS.

    captions : how many; losing : those of them that left objects out; objects, objects_kept,
    area, area_kept : sums of n_objects, n_kept, area and area_kept.
    """
    total: dict[str, float] = dict.fromkeys(
        ("captions", "losing", "objects", "objects_kept", "area", "area_kept"), 0
    )
    for table in captions:
        plain = table.filter(pc.equal(table["variant"], 0))
        total["captions"] += len(plain)
        losing = pc.less(plain["n_kept"], plain["n_objects"])
        for name, column in (
            ("losing", losing),
            ("objects", plain["n_objects"]),
            ("objects_kept", plain["n_kept"]),
            ("area", plain["area"]),
            ("area_kept", plain["area_kept"]),
        ):
            total[name] += pc.sum(column, min_count=0).as_py()
    return total


def budget_lines(found: Mapping[str, float], limit: int) -> list[str]:
    """One sentence on what the plain captions tell of within `limit` tokens."""
    if not found["captions"]:
        return []
    if not found["losing"]:
        return [f"every plain caption tells of all its objects within {limit} tokens"]
    return [
        f"{_share(found['losing'], found['captions'])} of the plain captions leave objects out to "
        f"stay within {limit} tokens; they all tell of {told(found)}"
    ]


def told(found: Mapping[str, float]) -> str:
    """`36% of the objects, 89% of their area`."""
    return (
        f"{_share(found['objects_kept'], found['objects'])} of the objects, "
        f"{_share(found['area_kept'], found['area'])} of their area"
    )


def import_lines(captions: Iterable[pa.Table], tokenizer: Tokenizer) -> list[str]:
    """How many imported texts an encoder will cut, and how many images have none.

    captions : tables that have COLUMNS.
    """
    nothing, longest = int(tokenizer.count([NOTHING])[0]), tokenizer.max_tokens
    texts = too_long = silent = 0
    for table in captions:
        texts += len(table)
        too_long += pc.sum(pc.greater(table["n_tokens"], longest), min_count=0).as_py()
        alone = pc.and_(pc.equal(table["variant"], 0), pc.equal(table["n_tokens"], nothing))
        silent += pc.sum(alone, min_count=0).as_py()
    lines = []
    if too_long:
        lines.append(
            f"{too_long:,} of {texts:,} texts are longer than the {longest} tokens of "
            f"{tokenizer.name}: an encoder with this tokenizer cuts them"
        )
    if silent:
        lines.append(f"{silent:,} images have no text, or nearly none, as in {NOTHING!r}")
    return lines


def _share(part: float, whole: float) -> str:
    return f"{part / whole:.0%}" if whole else "all"
