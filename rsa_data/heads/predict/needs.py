"""The files that a prediction needs, looked for before anything is loaded."""

from collections.abc import Callable, Sequence
from typing import Any

from ...common.errors import RsaDataError
from ...common.model_files import MissingFile
from ...common.units import size
from .. import reading
from ..description import Features
from .choices import Models
from .depth_model import check_depth_file, depth_of
from .images import segmenter_of


def check(
    about: dict[str, Any],
    models: Models,
    *,
    caption: bool,
    encoder: bool,
    depth: bool,
    first: Sequence[RsaDataError] = (),
) -> None:
    """Finds or downloads the models' files; RsaDataError lists all that are missing.

    caption : photos are described by the segmenter. encoder : captions are encoded. depth : the
    depth model runs. first : what is known to be missing already.
    """
    wanted: list[Callable[[], Any]] = []
    if caption:
        wanted.append(lambda: _segmenter(about, models))
    if encoder:
        wanted.append(lambda: reading.files(about, models.encoder_weights))
        wanted.append(lambda: _vocabulary(about))
    if depth:
        model = depth_of(about, models)["name"]
        wanted.append(lambda: check_depth_file(about, model, models))
    missing: list[RsaDataError] = [*first]
    for look in wanted:
        try:
            look()
        except RsaDataError as error:
            missing.append(error)
    if len(missing) == 1:
        raise missing[0]
    if missing:
        raise RsaDataError(_listed(missing))


def _listed(missing: Sequence[RsaDataError]) -> str:
    """All that is missing, a line each, and the command that fetches what can be fetched."""
    files = [error for error in missing if isinstance(error, MissingFile)]
    known = sum(file.card.bytes or 0 for file in files)
    more = "" if all(file.card.bytes for file in files) else " and those of unknown size"
    total = f" ({size(known)}{more})" if known else ""
    lines = [f"{len(missing)} files are missing{total}:"]
    lines += [f"- {e.line if isinstance(e, MissingFile) else e}" for e in missing]
    if names := [file.card.name for file in files if file.reason is not None]:
        reasons = "; ".join(dict.fromkeys(str(f.reason) for f in files if f.reason is not None))
        lines.append(
            f"The download failed: {reasons}. Where there is a network, this gets them: "
            f"rsa-data models fetch {' '.join(names)}"
        )
    if names := [file.card.name for file in files if file.reason is None]:
        lines.append(
            f"`models fetch` does not get {' and '.join(names)}: get the file yourself, from where "
            "the list says"
        )
    return "\n".join(lines)


def _segmenter(about: dict[str, Any], models: Models) -> None:
    from ...segments import detect

    options = segmenter_of(about, models)
    detect.check(**options)
    detect.files(**options)


def _vocabulary(about: dict[str, Any]) -> None:
    """The file by which CLIP's texts are cut into tokens, which its weights do not hold."""
    from ...common import clip_bpe

    features = Features.of(about["features"])
    encoders = [(one.options or {}).get("encoder") for one in (features, *(features.beside or []))]
    if "clip-rn50" in encoders and {"text", "objects"} & set(reading.reads(about)):
        clip_bpe.vocabulary()
