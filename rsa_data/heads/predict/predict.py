"""predict: from photos, captions or known points to scale and shift, and on to metric depth."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from ...common import bounded, text_files
from ...common.errors import RsaDataError, UsageError
from ...common.model_files import MissingFile
from ...common.options import accepts_old_names
from ...store.tables import WorkDir
from .. import ready
from . import needs
from .choices import Hints, Models, View
from .find import find, in_work
from .photos import opened
from .prediction import Prediction
from .run import Run


@accepts_old_names("predict")
def predict(
    work: WorkDir,
    photos: Sequence[Path] = (),
    *,
    head: str | None = None,
    caption: tuple[str, ...] = (),
    captions: Path | None = None,
    models: Models = Models(),
    hints: Hints = Hints(),
    view: View = View(),
) -> Iterator[Prediction]:
    """Metric depth of photos, or scale and shift of captions, one after the other.

    metric depth = 1 / (scale * relative depth + shift), one scale and one shift a photo; where the
    denominator is not positive it is inf. A scale for each region or pixel is out of scope.

    Parameters
    ----------
    photos : images, folders of images, and videos.
    head : a folder or file of a head, a head of the work dir, a ready head such as
        rsa-depth-anything, or an address (https:// or hf://OWNER/NAME). By default the work dir's
        own; with --known or --range none is needed.
    caption : description of the scene, instead of the segmenter's; may be repeated, one for each
        photo or one for all.
    captions : file with one caption a line.

    A photo that cannot be processed comes as a Prediction with its error. Raises UsageError for a
    call that cannot be meant and RsaDataError, which lists them all, when files are missing.
    """
    texts = [*caption, *_lines(captions)]
    if not photos and not texts and models.relative is None:
        raise UsageError("predict: expected photos, --caption TEXT or --captions FILE")
    if head is None and hints and texts and not in_work(work):
        raise UsageError(
            f"predict: a caption is read by a head, and {work.store.location} holds none: leave "
            "--caption out, since known distances are enough, or name a --head"
        )
    if hints.smooth > 1 and head is None and hints and not texts:
        raise UsageError(
            "predict: --smooth averages what a head says of each frame; known distances are fitted "
            "to each frame by itself: leave it out, or name a --head"
        )
    try:
        loaded = None if head is None and hints and not texts else find(work, head)
    except MissingFile as error:
        if head not in ready.names():
            raise
        _all_missing(head, models, bool(photos), bool(texts), error)
        raise
    about: dict[str, Any] = loaded.description if loaded else {}
    with ExitStack() as stack:
        every = stack.enter_context(opened(photos))
        if every and texts and len(texts) not in (1, len(every)):
            raise UsageError(
                f"predict: expected one caption for all photos or one each; found {len(texts)} for "
                f"{len(every)} photos"
            )
        if not every and len(texts) > 1 and (models.relative or hints):
            raise UsageError("predict: --relative and --known without photos take one --caption")
        if loaded is not None and not every and not texts:
            raise UsageError("predict: a head needs a photo or a --caption")
        if not every and hints and models.relative is None:
            raise UsageError("predict: --known and --range need a photo or --relative")
        if not loaded and not hints:
            raise UsageError(
                "predict: expected --head NAME, or known distances: --known u,v,metres"
            )
        yield from Run(loaded, about, texts, models, hints, view).over(every)


def _all_missing(head: str, models: Models, photos: bool, texts: bool, first: MissingFile) -> None:
    """Raises RsaDataError that lists all files that a published head needs, not one file a try."""
    about = ready.expected(head)
    check = partial(
        needs.check, about, models, caption=photos and not texts, encoder=True, first=[first]
    )
    try:
        check(depth=photos and models.relative is None)
    except UsageError:  # its depth model cannot be run here
        check(depth=False)


def _lines(path: Path | None) -> list[str]:
    if path is None:
        return []
    try:
        lines = text_files.lines(bounded.read_text(path))
    except OSError as error:
        raise RsaDataError(
            f"--captions {path}: expected UTF-8 text, a caption a line: {error}"
        ) from error
    return [line.strip() for line in lines if line.strip()]
