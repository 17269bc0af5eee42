"""Heads that others have published, by name: their files, and what they were trained with."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..common import cards, model_files
from .description import FORMAT
from .released import ENCODER

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


def expected(name: str) -> dict[str, Any]:
    """What the description of a published head says of its inputs, before its file is here."""
    features = {"dim": 1, "encoder": ENCODER, "options": {"encoder": ENCODER, "normalize": False}}
    about = {"format": FORMAT, "architecture": {"name": "mlp3"}, "features": features}
    return about | {"depth_model": _depth_model(ready(name))}


def _depth_model(found: Ready) -> dict[str, Any]:
    return {
        "model": found.depth_model,
        "options": None,
        "files": None,
        "stage_version": None,
        "geometry": {"published": {"geometry": found.geometry, "crop": "none"}},
    }


def load(name: str) -> "ScaleHead":
    """The head, from the cache or downloaded and checked.

    Its own file does not say what it was trained with: the card does.
    """
    from .checkpoint import ScaleHead

    found = ready(name)
    head = ScaleHead.load(model_files.local_file(found.card, option="--head"))
    description = head.description
    description["depth_model"] = _depth_model(found)
    return ScaleHead(head.network, description, head.mean, head.factor)
