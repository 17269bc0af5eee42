"""Cards of depth models: what a file wants to see and what it answers."""

from pathlib import Path

from ..common import forms
from ..common.cards import Card, card_of, read_card
from ..common.errors import RsaDataError, unknown

# What each way of resizing needs in the card.
_NEEDED = {
    "squash": ("width", "height"),
    "keep-aspect": ("size", "multiple"),
    "centre-crop": ("short", "size"),
}

_FORM = {"resize": "text", "output": "text", "output_name?": "text"}
_FORM |= {f"{key}?": "a side in px" for key in ("width", "height", "size", "multiple", "short")}
_FORM |= {f"{key}?": "a list of 3 numbers" for key in ("mean", "std")}
# One head may be trained on another file of the model for each dataset.
_FORM["file_by_dataset?"] = "true or false"


def card_for(name: str, card: Path | None) -> Card:
    """The card of the user's own, or the shipped one; RsaDataError where it is not complete."""
    found = read_card(card) if card is not None else card_of("relative-depth", name)
    where, settings = f"model card {card or name}", found.settings
    if found.kind != "relative-depth":
        raise RsaDataError(f'{where}: expected kind = "relative-depth", found {found.kind!r}')
    if strange := settings.keys() - {key.removesuffix("?") for key in _FORM}:
        raise RsaDataError(
            f"{where}: expected the keys {', '.join(key.removesuffix('?') for key in _FORM)}; "
            f"found {', '.join(sorted(strange))}"
        )
    forms.check(settings, _FORM, where)
    for key, choices in (("resize", _NEEDED), ("output", ("inverse", "depth"))):
        if settings[key] not in choices:
            raise RsaDataError(f"{where}: {unknown(key, settings[key], choices)}")
    if missing := [key for key in _NEEDED[settings["resize"]] if key not in settings]:
        raise RsaDataError(
            f'{where}: expected {", ".join(missing)} in px, for resize = "{settings["resize"]}"'
        )
    if 0 in settings.get("std", ()):
        raise RsaDataError(f"{where}: std: expected numbers other than 0, found 0")
    return found
