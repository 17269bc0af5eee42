"""What can be evaluated: heads, constants, oracles; each makes depth of an image's valid pixels."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..common.errors import RowError
from . import oracles
from .inputs import Image, TestPart

if TYPE_CHECKING:
    from ..heads.belong import Source
    from ..heads.checkpoint import ScaleHead


@dataclass(frozen=True)
class Prediction:
    """Metric depth of an image's valid pixels, before clipping.

    depth : float64 of shape (n,), m. scale, shift : what made it of y, or None.
    """

    depth: np.ndarray
    scale: float | None = None
    shift: float | None = None


# A part, then each of its images -> its prediction; raises RowError where there is none.
Method = Callable[[TestPart], Callable[[Image], Prediction]]
# Features of shape (n, dim) -> scale and shift of shape (n,), as rsa_data.ScaleHead.
Head = Callable[[np.ndarray], tuple[Any, Any]]


def by_head(
    head: Head,
    source: "Source",
    variant: int = 0,
    see: Callable[..., np.ndarray] | None = None,
    read: Callable[[TestPart], tuple[np.ndarray, np.ndarray]] | None = None,
) -> Method:
    """The scale and shift that a head gives for what it reads of each image.

    see : (features, which images have one, part=number) -> the features that a control head sees.
    read : what it reads of a part in place of the source's tables, as `TestPart.seen` gives it.
    """

    def method(part: TestPart) -> Callable[[Image], Prediction]:
        features, there = part.seen(source, variant) if read is None else read(part)
        if see is not None:
            features = see(features, there, part=part.number)
        scales, shifts = np.zeros(len(there)), np.zeros(len(there))
        if there.any():
            scales[there], shifts[there] = head(features[there])

        def predict(image: Image) -> Prediction:
            if not there[image.row]:
                raise RowError("no caption" if source.captions else "no feature")
            return scaled(image, float(scales[image.row]), float(shifts[image.row]))

        return predict

    return method


def by_constant(scale: float, shift: float) -> Method:
    """One scale and shift for every image."""
    return lambda part: lambda image: scaled(image, scale, shift)


def by_oracle(
    fit: Callable[[Image], tuple[float, float] | None],
) -> Method:
    """The scale and shift that a fit to the image's own ground truth gives."""

    def predict(image: Image) -> Prediction:
        found = fit(image)
        if found is None:
            raise RowError("the relative depth leaves this fit open")
        return scaled(image, *found)

    return lambda part: predict


def oracle_methods(max_depth: float) -> Mapping[str, Method]:
    """The three oracles by the names that tables give them."""
    return {
        "median": by_oracle(lambda image: image.fits.median),
        "linear fit": by_oracle(lambda image: image.fits.linear),
        "linear fit in depth": by_oracle(lambda image: image.fits.in_depth(max_depth)),
    }


def scaled(image: Image, scale: float, shift: float) -> Prediction:
    """The prediction of a scale and shift; raises RowError where they are not finite."""
    if not np.isfinite([scale, shift]).all():
        raise RowError(f"expected a finite scale and shift; found {scale} and {shift}")
    return Prediction(oracles.metric(image.y, scale, shift), scale, shift)


_CONTROLS = {"shuffled": "captions shuffled", "dataset": "dataset name only"}


def label_of(name: str, head: "ScaleHead") -> str:
    """What a table calls a head: its name, or what kind of control it is."""
    return _CONTROLS.get(head.about.control, name)


def head_method(head: "ScaleHead", source: "Source") -> Method:
    """A head on a dataset's tables; a control sees no more than it was trained to see."""
    from ..heads.train.control_heads import controlled_features

    see = partial(
        controlled_features,
        control=head.about.control,
        seed=(head.about.options or {}).get("seed", 0),
        dataset=source.dataset,
        datasets=list(head.about.trained_on),
    )
    return by_head(head.outputs, source, see=see)
