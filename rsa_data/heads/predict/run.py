"""One call of predict: what is loaded once, and the photos one after the other."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...common.errors import RowError, RsaDataError, UsageError
from ..reading import reads
from . import known_depth, needs
from .camera import camera_of
from .choices import Hints, Models, View
from .depth_model import only_rendered
from .distances import measure
from .images import (
    captions_of,
    describer,
    relative_map,
    relative_source,
    segmenter_of,
)
from .objects import seen
from .photos import Photo
from .prediction import Prediction

if TYPE_CHECKING:
    from ...segments.segments import Segments
    from ..checkpoint import ScaleHead
    from .asking import Asking

# A known distance above this, m, is more often one in another unit.
_FAR = 300.0
# Width over height of an equirectangular panorama.
_PANORAMA = (1.98, 2.02)


class Run:
    """One call: what is loaded once, and the photos one after the other."""

    def __init__(
        self,
        head: "ScaleHead | None",
        about: dict[str, Any],
        texts: list[str],
        models: Models,
        hints: Hints,
        view: View,
    ):
        self.head, self.about, self.texts = head, about, texts
        self.models, self.hints, self.view = models, hints, view
        self.kinds = reads(about)
        self.ask: Asking | None = None
        self.without_depth = ""
        self.shared: list[str] = []

    def over(self, photos: list[Photo]) -> Iterator[Prediction]:
        """The predictions, in order."""
        self._check(bool(photos))
        if self.head is not None:
            from .asking import Asking

            self.ask = Asking(self.head, self.models.encoder_weights, self.models.style)
        if not photos:
            for p in self._of_texts():
                yield self._with_map(p) if self.models.relative else p
            return
        found = self._described(photos)
        if len(photos) > 1 and self.hints.known:
            shared = f"the same known points are taken to hold in all {len(photos)} photos"
            self.shared = [shared]
        if self.hints.smooth > 1:
            found = iter(self._smoothed(list(found)))
        depth = _PerRoot(
            lambda root: (
                None if self.without_depth else relative_source(self.about, root, self.models)
            )
        )
        for photo, segments, p in found:
            if not p.error:
                try:
                    self._finish(photo, segments, p, depth(photo.root))
                except (RsaDataError, RowError) as error:
                    if isinstance(error, UsageError):
                        raise
                    p.error = str(error)
            yield p

    def _check(self, photos: bool) -> None:
        """Looks for all files at once; a head that cannot have depth here gives words alone."""
        if "image" in self.kinds and not photos:
            raise UsageError("predict: this head reads the photo itself: give one")
        describes = photos and self._looks()
        if not describes and (self.models.segmenter_weights or self.models.card):
            option = "--segmenter-weights" if self.models.segmenter_weights else "--card"
            raise UsageError(
                f"predict: {option} has no effect here, since nothing looks for objects: name the "
                "segmenter with --segments NAME and give a photo, or leave it out"
            )
        runs = photos and self.models.relative is None
        try:
            needs.check(
                self.about,
                self.models,
                caption=describes,
                encoder=self.head is not None,
                depth=runs,
            )
        except UsageError as error:
            if self.hints or self.models.depth_model is not None:
                raise
            if describes and only_rendered(self.about):
                raise  # before files are asked for that would tell nothing of a photo
            self.without_depth = str(error).removeprefix("predict: ")
            encodes = self.head is not None
            needs.check(self.about, self.models, caption=describes, encoder=encodes, depth=False)

    def _looks(self) -> bool:
        """Whether a segmenter looks at the photos."""
        told = bool(self.texts) or self.kinds == ("image",)
        return (self.head is not None and not told) or self.models.segments is not None

    def _of_texts(self) -> list[Prediction]:
        if self.ask is None:
            assert self.models.relative is not None
            return [Prediction(None, name=self.models.relative.name)]
        return [self.ask(text) for text in self.texts]

    def _described(
        self, photos: list[Photo]
    ) -> "Iterator[tuple[Photo, Segments | None, Prediction]]":
        look = _PerRoot(lambda root: describer(self.about, root, self.models))
        for k, photo in enumerate(photos):
            segments, image, p = None, None, Prediction(None)
            text = self.texts[k % len(self.texts)] if self.texts else None
            try:
                photo.fetch()
                if self._looks():
                    segments, own = look(photo.root)(photo.name)
                    text = text or own or None
                if "image" in self.kinds:
                    image = _read(photo)
                if self.ask is not None:
                    p = self.ask(text, None if self.texts else segments, image)
                p.name, p.image = photo.name, image
                p.warnings += [photo.warning] if photo.warning else []
                if text is not None and not self.texts and not self.about.get("captions"):
                    style = captions_of(self.about, self.models)["style"]
                    p.notes.append(
                        f"caption in the style {style}: the head does not say which texts it "
                        "was trained on (--style chooses another)"
                    )
            except RsaDataError as error:
                if isinstance(error, UsageError):
                    raise
                p = Prediction(text, name=photo.name, error=str(error))
            yield photo, segments, p

    def _smoothed(self, found: list[Any]) -> list[Any]:
        good = [p for _, _, p in found if not p.error]
        for name in ("scale", "shift") if good and self.head is not None else ():
            values = np.array([getattr(p, name) for p in good])
            for p, value in zip(good, known_depth.smooth(values, self.hints.smooth), strict=True):
                setattr(p, name, float(value))
        return found

    def _finish(
        self, photo: Photo, segments: "Segments | None", p: Prediction, source: Any
    ) -> None:
        """Adds image, camera, depth and distances."""
        photo.fetch()
        p.image = _read(photo) if p.image is None else p.image
        height, width = p.image.shape[:2]
        p.camera = camera_of(photo.path, width, height, self.view)
        if _PANORAMA[0] < width / height < _PANORAMA[1] and "assumed" in p.camera.source:
            p.warnings.append(
                "twice as wide as high: of a 360-degree panorama these models see a bent picture, "
                "and points and mesh are of a camera without distortion"
            )
        if self.without_depth:
            p.warnings.append(f"no depth: {self.without_depth}")
        else:
            self._measure(p, relative_map(source, photo.name, (height, width)))
        if segments is not None:
            p.segmenter = str(segmenter_of(self.about, self.models)["segments"])
            p.objects = seen(segments, p.depth)
            p.notes += [] if p.objects else [f"no objects were found by {p.segmenter}"]
        else:
            p.notes.append("no objects: nothing looked for them (--segments NAME does)")

    def _measure(self, p: Prediction, y: np.ndarray) -> None:
        p.warnings += self.shared
        in_metres(p, y, self.hints, self.about)

    def _with_map(self, p: Prediction) -> Prediction:
        """Depth of a map without its photo."""
        y = relative_map(relative_source(self.about, Path(), self.models), p.name, None)
        p.camera = camera_of(None, y.shape[1], y.shape[0], self.view)
        self._measure(p, y)
        return p


def in_metres(p: Prediction, y: np.ndarray, hints: Hints, about: dict[str, Any]) -> None:
    """Adds depth and known distances, and asks about distances that are hardly in metres.

    about : head.json, {} without a head. Otherwise as `distances.measure`.
    """
    measure(p, y, hints, about.get("prior"), bool(about))
    if far := [k.name for k in p.known if k.metres > _FAR]:
        p.warnings.append(
            f"known distances above {_FAR:g} m: {', '.join(far)}; are they in metres?"
        )


def _read(photo: Photo) -> np.ndarray:
    """The photo, uint8 (h, w, 3), RGB; raises RsaDataError where it cannot be read."""
    from ...datasets.images import read_image

    try:
        return read_image(photo.path)
    except RowError as error:
        raise RsaDataError(str(error)) from error


class _PerRoot:
    """What is made for the root of each photo, once for photos that follow each other."""

    def __init__(self, make: Callable[[Path], Any]):
        self.make = make
        self.root: Path | None = None
        self.made: Any = None

    def __call__(self, root: Path) -> Any:
        if root != self.root:
            self.root, self.made = root, self.make(root)
        return self.made
