"""Heads that others have published, by name: their files, and what they were trained with."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..common import cards, model_files

if TYPE_CHECKING:
    from .checkpoint import ScaleHead

KIND = "head"


@dataclass(frozen=True)
class Ready:
    """A published head.

    depth_model, geometry : what its relative depth was made with; WIDTHxHEIGHT in px.
    """

    card: cards.Card
    depth_model: str
    geometry: str | None


def names() -> list[str]:
    """Names of the published heads."""
    return cards.names(KIND)


def ready(name: str) -> Ready:
    """A published head by its name; raises UsageError when there is none of that name."""
    card = cards.card_of(KIND, name)
    return Ready(card, card.settings["depth_model"], card.settings.get("geometry"))


def load(name: str) -> "ScaleHead":
    """The head, from the cache or downloaded and checked.

    Its own file does not say what it was trained with: the card does.
    """
    from .checkpoint import ScaleHead

    found = ready(name)
    head = ScaleHead.load(model_files.local_file(found.card, option="--head"))
    description = head.description
    description["depth_model"] = {
        "model": found.depth_model,
        "options": None,
        "files": None,
        "stage_version": None,
        "geometry": {"published": {"geometry": found.geometry, "crop": "none"}},
    }
    return ScaleHead(head.network, description, head.mean, head.factor)
