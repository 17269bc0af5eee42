"""What a captions table leaves out, and which option would leave out less."""

import json
from collections.abc import Iterable, Mapping
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from ..common.tokenizers import Tokenizer
from .wordings.wording import NOTHING

# What the sentences below are made of, not all that a captions table holds.
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
    """What the plain captions name within `limit` tokens, in a sentence."""
    if not found["captions"]:
        return []
    if not found["losing"]:
        return [f"Every plain caption names all objects of its image within {limit} tokens."]
    return [
        f"{_share(found['losing'], found['captions'])} of the plain captions leave objects out to "
        f"stay within {limit} tokens. Together, the plain captions name {named(found)}."
    ]


def alternatives(now: Mapping[str, float], would: Mapping[str, Mapping[str, float]]) -> list[str]:
    """The options that would keep more, a line each after a line that introduces them.

    now : sums over a few captions as they are; would : over the same with other options, by these.
    """
    better = {flags: sums for flags, sums in would.items() if sums["area_kept"] > now["area_kept"]}
    if not better:
        return []
    return [
        f"On the {now['captions']:,} images of the first part, the plain captions name "
        f"{named(now)}. With other options they would name:",
        *(f"  {flags}: {named(sums)}" for flags, sums in better.items()),
    ]


def named(found: Mapping[str, float]) -> str:
    """`36% of the objects (89% of their area)`."""
    return (
        f"{_share(found['objects_kept'], found['objects'])} of the objects "
        f"({_share(found['area_kept'], found['area'])} of their area)"
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
            f"{too_long:,} of {texts:,} texts {'is' if too_long == 1 else 'are'} longer than the "
            f"{longest} tokens that an encoder with the tokenizer {tokenizer.name} reads. Their "
            "ends will be cut off."
        )
    if silent:
        has = "image has" if silent == 1 else "images have"
        lines.append(f"{silent:,} {has} no text, or one as short as {NOTHING!r}.")
    return lines


def failed_lines(captions: Iterable[pa.Table]) -> list[str]:
    """How many images have no text for a reason that their step left in the table's metadata."""
    failed: list[tuple[str, str]] = []
    for table in captions:
        audit = json.loads((table.schema.metadata or {}).get(b"audit", b"{}"))
        failed += audit.get("failed", {}).items()
    if not failed:
        return []
    name, reason = failed[0]
    has = "image has" if len(failed) == 1 else "images have"
    return [
        f"{len(failed):,} {has} no text and got {NOTHING!r}. The receipts name them; "
        f"the first is {name}: {reason}"
    ]


def _share(part: float, whole: float) -> str:
    return f"{part / whole:.0%}" if whole else "all"
