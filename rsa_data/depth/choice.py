"""Which depth model is meant, by name or by a card of the user's own, and what files it reads."""

from pathlib import Path
from typing import Any

from .. import registry
from ..common.cards import read_card
from ..common.errors import UsageError
from ..common.model_files import with_data

# The entry whose builder runs a card of the user's own.
_BY_CARD = "depth-anything-v2-small"


def entry(name: str, card: Path | None) -> str:
    """The registry's entry that runs a model; any name will do for a card of the user's own."""
    return _BY_CARD if card is not None else name


def check(
    *, depth_model: str | None = None, card: Path | None = None, device: str = "auto", **_: Any
) -> None:
    """Refuses a model that is not in the registry, unless a card describes it."""
    if depth_model is None and card is None:
        raise UsageError("depth: expected --depth-model NAME, or --card FILE of your own model")
    name = registry.DEPTH_MODELS.split(depth_model or "")[0]
    if name == "files" and device != "auto":
        raise UsageError("depth model files: --device has no effect here: leave it out")
    if card is not None and name == "files":
        raise UsageError("depth model files: --card has no effect here: leave it out")
    registry.check("depth model", registry.DEPTH_MODELS, entry(name, card))


def label(*, depth_model: str | None = None, card: Path | None = None, **_: Any) -> str | None:
    """The name of a card of the user's own, where no other name was given for its table."""
    return read_card(card).name if card is not None and depth_model is None else None


def files(
    *,
    depth_model: str | None = None,
    depth_weights: Path | None = None,
    card: Path | None = None,
    geometry: str | None = None,
    device: str = "auto",
    **_: Any,
) -> dict[str, Path]:
    """The files that these options read, model and card; none for depth that lies in files.

    Raises UsageError for options that do not go together, before anything is begun.
    """
    check(depth_model=depth_model, card=card, device=device)
    name, argument = registry.DEPTH_MODELS.split(depth_model or "")
    if not registry.DEPTH_MODELS.is_own(entry(name, card)):
        registry.resolve("depth model", registry.DEPTH_MODELS, name)
        return {} if depth_weights is None else {"model": depth_weights}
    if name == "files":
        if argument and not Path(argument).is_dir():
            raise UsageError(f"depth model {depth_model}: there is no such folder")
        return {}
    from .onnx import fixed, model_file

    if argument:
        raise UsageError(f"depth model {name}: takes no argument, found {argument!r}")
    if geometry is not None:
        fixed(geometry)
    path = model_file(name, depth_weights, card)
    return with_data("model", path) | ({"card": card} if card is not None else {})
