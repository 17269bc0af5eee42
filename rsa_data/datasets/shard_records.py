"""The JSON member of a sample in a shard: its fields for scene, split and intrinsics."""

import json
from pathlib import Path
from typing import Any

from ..common import bounded
from ..common.errors import RowError, RsaDataError
from .cameras import UNKNOWN, Camera, from_numbers
from .shards import address, located
from .tar_members import Entry


def read_json(root: Path, shard: str, entry: Entry | None, where: str) -> dict[str, Any]:
    """The JSON object of a sample's .json member; raises RsaDataError when there is none."""
    if entry is None:
        raise RsaDataError(f"{where}: expected a member .json with its fields, found none")
    path = address(shard, entry.place, entry.size, entry.name)
    try:
        found = bounded.parse_json(bounded.read(located(root / path), "record"))
    except (ValueError, RowError) as error:
        raise RsaDataError(f"{where}.json: expected JSON, found: {error}") from error
    if not isinstance(found, dict):
        raise RsaDataError(f"{where}.json: expected an object, found {json.dumps(found):.60}")
    return found


def text_of(about: dict[str, Any], field: str | None, where: str) -> str | None:
    """A field that names a scene or a split; None where no field is asked for.

    Raises RsaDataError unless it is a text or a whole number without a slash.
    """
    if field is None:
        return None
    value = about.get(field)
    if not isinstance(value, (str, int)) or not str(value) or "/" in str(value):
        raise RsaDataError(f"{where}.json: {field}: expected a name without /, found {value!r:.60}")
    return str(value)


def camera_of(about: dict[str, Any], field: str | None, where: str) -> Camera:
    """The intrinsics in a field, px; UNKNOWN where the field is not asked for or absent."""
    if field is None or about.get(field) is None:
        return UNKNOWN
    return from_numbers(about[field], f"{where}.json: {field}")
