"""The files that a prediction needs, looked for before anything is loaded."""

from collections.abc import Callable
from typing import Any

from ...common.errors import RsaDataError
from .. import reading
from .choices import Models
from .images import check_depth_file, depth_of, segmenter_of


def check(
    about: dict[str, Any], models: Models, *, caption: bool, encoder: bool, depth: bool
) -> None:
    """Finds or downloads the models' files; RsaDataError lists all that are missing.

    caption : photos are described by the segmenter. encoder : captions are encoded. depth : the
    depth model runs.
    """
    wanted: list[Callable[[], Any]] = []
    if caption:
        wanted.append(lambda: _segmenter(about, models))
    if encoder:
        wanted.append(lambda: _encoder(about, models))
    if depth:
        model = depth_of(about, models)["name"]
        wanted.append(lambda: check_depth_file(about, model, models.depth_weights))
    missing = []
    for look in wanted:
        try:
            look()
        except RsaDataError as error:
            missing.append(error)
    if len(missing) == 1:
        raise missing[0]
    if missing:
        listed = "\n".join(f"- {error}" for error in missing)
        raise RsaDataError(f"{len(missing)} files are missing:\n{listed}")


def _segmenter(about: dict[str, Any], models: Models) -> None:
    from ...segments import detect

    options = segmenter_of(about, models)
    detect.check(**options)
    detect.files(**options)


def _encoder(about: dict[str, Any], models: Models) -> None:
    reading.files(about, models.encoder_weights)
