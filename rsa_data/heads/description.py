"""head.json as it is read: its form, whatever somebody did to it."""

import json
from typing import Any

from ..common import forms
from ..common.errors import RsaDataError

FORMAT = 1

_FEATURES = {
    "dim": "a side in px",
    "encoder?": "text or nothing",
    "style?": "text or nothing",
    "options?": "an object or nothing",
    "files?": "an object or nothing",
}
_NUMBERS = dict.fromkeys(("scale", "shift", "correlation"), "a number")
_FORM = {
    "architecture": {"name": "text", "*": "a size or a number"},
    "features": _FEATURES,
    "far?": "a number or nothing",
    "datasets?": {"*": {"tables?": {"*": "text"}}},
    "captions?": {"*": "an object"},
    "segments?": {"*": "text"},
    "depth_model?": {"model?": "text or nothing", "geometry?": "an object"},
}


def parse(data: bytes, where: str) -> dict[str, Any]:
    """The description of a head; raises RsaDataError that names the first place that is wrong."""
    try:
        found = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise RsaDataError(f"{where}: does not describe a head: {error!r}") from error
    forms.check(found, {"format": "a whole number"}, f"{where}: does not describe a head")
    if found["format"] != FORMAT:
        raise RsaDataError(
            f"{where}: expected format {FORMAT}; found {found['format']}: written by another "
            "version of rsa-data"
        )
    forms.check(found, _FORM, f"{where}: does not describe a head")
    if found.get("prior") is not None:
        forms.check(found["prior"], _NUMBERS, f"{where}: does not describe a head: prior")
    return found
