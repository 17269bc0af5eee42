"""What there is of each model: its file, size, licence and digest."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...common import cards, model_files
from ...common.errors import RsaDataError, unknown
from ...common.units import size

KINDS = ("segments", "relative-depth", "text-encoder", "head")


@dataclass(frozen=True)
class Entry:
    """A model of a shipped card; path : its file on this machine, or None."""

    card: cards.Card
    path: Path | None

    @property
    def row(self) -> list[str]:
        """Name, kind, size, licence and digest, as a line of a table has them."""
        there = size(self.path.stat().st_size) if self.path else "not here"
        if self.path is None and self.card.bytes:
            there += f", {size(self.card.bytes)}"
        if self.path is None and not (self.card.hub or self.card.url):
            there = f"no download: {model_files.OPTIONS[self.card.kind or '']} FILE"
        digest = (self.card.sha256 or "")[:12]
        return [self.card.name, self.card.kind or "", there, self.card.licence or "", digest]


def names() -> list[str]:
    """All models that a card names, kind by kind."""
    return [name for kind in KINDS for name in cards.names(kind)]


def entries(wanted: Sequence[str] = ()) -> list[Entry]:
    """The models asked for, or all. Raises UsageError for an unknown name."""
    for name in wanted:
        if name not in names():
            raise unknown("model", name, names())
    found = [cards.read_card(cards.card_path(name)) for name in wanted or names()]
    return [Entry(card, model_files.found(card)) for card in found]


def fetch(wanted: Sequence[str]) -> dict[str, Path | RsaDataError]:
    """Downloads and checks the models asked for; by name their file, or why there is none."""
    got: dict[str, Path | RsaDataError] = {}
    for entry in entries(wanted):
        try:
            got[entry.card.name] = model_files.local_file(entry.card, option=None)
        except RsaDataError as error:
            got[entry.card.name] = error
    return got
