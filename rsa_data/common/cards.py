"""Model cards: what a model is, as data.

A card is one TOML file. Its common keys are the fields of `Card`; every other key belongs to the
code of its kind (segments, relative-depth, text-encoder) and stands in `settings`.
"""

from pathlib import Path
from typing import Any

import msgspec

from . import bounded, forms, typed
from .errors import RsaDataError, unknown

CARDS = Path(__file__).parent / "model_cards"


class Card(msgspec.Struct, frozen=True, kw_only=True):
    """What a model is and where its file comes from.

    name : the card's file name without its ending, unless the card says another.
    kind : which part of the project runs the model.
    licence : of the weights. about : one line for `rsa-data list`.
    tested : whether this project has run the model with its real weights.
    hub, file, revision : a file of the Hugging Face hub. url : a file anywhere else. A card with
        neither is for a file that the user has.
    sha256, bytes : of the model's file: its digest and its size.
    source : where a user gets a file that is not downloaded, in words.
    settings : the keys of the card that belong to the code of its kind.
    """

    name: str
    kind: str | None = None
    licence: str | None = None
    about: str | None = None
    tested: bool = False
    hub: str | None = None
    file: str | None = None
    revision: str | None = None
    url: str | None = None
    sha256: str | None = None
    bytes: int | None = None
    source: str | None = None
    settings: dict[str, Any] = {}

    def __post_init__(self) -> None:
        if not forms.is_path(self.name) or "/" in self.name or self.name == "..":
            raise ValueError(f"expected the name of a file; found {forms.found(self.name)}")
        for key in ("file", "url"):
            if (value := getattr(self, key)) is not None and not forms.is_path(value):
                raise ValueError(f"{key}: expected a path; found {forms.found(value)}")
        # A source that cannot be checked is none.
        if self.hub and not (self.file and (self.revision or self.sha256)):
            raise ValueError(f"with hub = {self.hub!r} expected file, and revision or sha256")
        if self.url and not self.sha256:
            raise ValueError("with a url expected its sha256; found none")


_COMMON = set(Card.__struct_fields__) - {"settings"}


def read_card(path: Path) -> Card:
    """A card from its file.

    Raises RsaDataError when the file is missing, is not TOML, has a value of the wrong type, or
    names a source that cannot be checked: a url needs a sha256, a hub file a revision or a sha256.
    """
    where = f"model card {path}"
    try:
        content = bounded.read_toml(path)
    except (OSError, ValueError) as error:
        raise RsaDataError(f"{where}: expected a TOML file; found: {error}") from error
    common = {key: content.pop(key) for key in _COMMON & content.keys()}
    return typed.convert({"name": path.stem, **common, "settings": content}, Card, where)


def names(kind: str) -> list[str]:
    """The names of the shipped cards of a kind."""
    return [p.stem for p in sorted(CARDS.glob("*.toml")) if read_card(p).kind == kind]


def about(name: str) -> str | None:
    """What a shipped card says of its model, with the licence; None where it says nothing."""
    path = CARDS / f"{name}.toml"
    card = read_card(path) if path.is_file() else None
    if card is None or card.about is None:
        return None
    tested = "" if card.tested else "; not yet run with its real weights"
    licence = "no licence stated" if card.licence in (None, "none stated") else card.licence
    return f"{card.about}; {licence}{tested}"


def card_path(name: str) -> Path:
    """The file of a shipped card; raises UsageError, with the nearest name, when there is none."""
    path = CARDS / f"{name}.toml"
    if not path.is_file():
        raise unknown("model", name, (p.stem for p in CARDS.glob("*.toml")))
    return path


def card_of(kind: str, name: str) -> Card:
    """The shipped card `name`; raises UsageError when there is none of that kind."""
    card = read_card(card_path(name))
    if card.kind != kind:
        raise unknown(f"{kind} model", name, names(kind))
    return card
