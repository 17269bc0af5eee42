"""The depth model that a head needs for a photo, and why it may have none."""

from typing import Any

from ...common.errors import RsaDataError, UsageError
from ...store.table_names import plain_name
from .choices import Models

# Without a head that names its own.
DEPTH_MODEL = "depth-anything-v2-small"


def depth_of(about: dict[str, Any], models: Models) -> dict[str, Any]:
    """Options of the depth model for new photos: name, geometry and crop.

    Raises UsageError when the head does not say how its relative depth was made, or was made for
    another depth model than the one asked for.
    """
    from ... import registry

    model = about.get("depth_model") or {}
    # The table may have another label than its model.
    own = (model.get("options") or {}).get("depth_model") or model.get("model")
    if not about or own is None:
        if about and models.depth_model is None and models.depth_card is None:
            raise UsageError(
                "predict: the head does not say which depth model it was trained for: give the "
                "photos' relative depth with --relative, or name the model with --depth-model"
            )
        name = models.depth_model or ("card" if models.depth_card else DEPTH_MODEL)
        return {"name": name, "geometry": None, "crop": "none"}
    if own == "files":
        raise UsageError(f"predict: {_from_files(about)}")
    if own not in registry.DEPTH_MODELS and models.depth_card is None:
        raise UsageError(
            f"predict: the head was trained for the depth model {own}, which cannot be run here: "
            "give its model card with --depth-card, or the photos' relative depth from it with "
            "--relative"
        )
    if models.depth_model is not None and plain_name(models.depth_model) != own:
        raise UsageError(
            f"--depth-model {models.depth_model}: expected {own}, for which the head was trained: "
            "scale and shift of one depth model do not fit another one"
        )
    ways = {str(g): g for g in model.get("geometry", {}).values()}
    if len(ways) > 1:
        raise UsageError(
            "predict: the head was trained on several geometries of its depth model "
            f"({'; '.join(ways)}): give --relative, made in one of these ways"
        )
    way: dict[str, Any] = next(iter(ways.values()), {})
    return {"name": own, "geometry": way.get("geometry"), "crop": way.get("crop") or "none"}


def only_rendered(about: dict[str, Any]) -> bool:
    """Whether the relative depth of a head came from files of rendered scenes alone."""
    model = about.get("depth_model") or {}
    own = (model.get("options") or {}).get("depth_model") or model.get("model")
    used = (about.get("datasets") or {}).values()
    return own == "files" and bool(used) and all(dataset.get("synthetic") for dataset in used)


def _from_files(about: dict[str, Any]) -> str:
    """Why a head whose relative depth came from files has none for a photo, and the way out."""
    alone = (
        "Known distances need no head: rsa-data predict PHOTO --known u,v,metres; docs/tutorial-own"
        ".md trains a head on your own images"
    )
    if only_rendered(about):
        return (
            "the head was trained on rendered relative depth, and no depth model gives the like "
            f"for a photo: its scale and shift fit rendered scenes only. {alone}"
        )
    return (
        "the head's relative depth came from files, and which model made them is not known: give "
        "the photo's own with --relative FILE (.npy, or 16-bit PNG as value / 65535), made by the "
        f"same model at the same size of input. {alone}"
    )


def check_depth_file(about: dict[str, Any], model: str, models: Models) -> None:
    """Finds the depth model's files; RsaDataError when one is missing or is not the head's."""
    from ...common.digests import file_sha256
    from ...depth import choice

    known = about.get("depth_model") or {}
    each = [known, *(known.get("geometry") or {}).values()]
    paths = choice.files(
        depth_model=model, depth_weights=models.depth_weights, card=models.depth_card
    )
    for name, path in paths.items():
        wanted = {str(one["files"][name]) for one in each if (one.get("files") or {}).get(name)}
        if wanted and (found := file_sha256(str(path))) not in wanted:
            raise RsaDataError(
                f"depth model {model}: the head was trained with another file: expected sha256 "
                f"{' or '.join(sorted(wanted))}; found {found} in {path.name}"
            )
