"""What a head reads, made on the spot for photos and captions that are in no table."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..common.errors import RsaDataError, UsageError
from .belong import kinds_of
from .description import Features, Input
from .inputs import kinds
from .inputs.scene import Live, Maker, Scene


class Reading:
    """The encoders of a head in memory: scenes -> rows of features.

    features : of head.json, typed or as plain values. weights : the encoder's file, where it is not
    found by itself; of several encoders it is that of the one it fits.
    kinds : of input, in the order of their columns.

    Raises UsageError for an input that cannot be made on the spot, RsaDataError where the encoder's
    file is missing or is not the one that the head was trained with.
    """

    def __init__(self, features: Features | dict[str, Any], weights: Path | None = None):
        of = features if isinstance(features, Features) else Features.of(features)
        self.kinds = kinds_of(of)
        self._makers: list[Maker] = [
            live.load(one.options or {}, own) for live, one, own in _checked(of, weights)
        ]

    def __call__(self, scenes: Sequence[Scene]) -> np.ndarray:
        """float32 (n, width); scenes with fewer objects than others are filled up with zeros."""
        return np.concatenate([make(scenes) for make in self._makers], axis=1)


def reads(about: dict[str, Any]) -> tuple[str, ...]:
    """The kinds of input that a head reads; about : head.json, or {} without a head."""
    return kinds_of(Features.of(about["features"])) if about else ()


def encode(features: Any, captions: Sequence[str], weights: Path | None = None) -> np.ndarray:
    """Features of captions, (n, dim), by the encoder that a head was trained on.

    features : `features` of head.json. weights : the encoder's file, where it is not found by
    itself. Raises UsageError for a head that reads more than captions.
    """
    of = features if isinstance(features, Features) else Features.of(features)
    if kinds_of(of) != ("text",):
        raise UsageError(
            f"this head reads {of.style} features of {of.encoder}, not captions alone: call "
            "rsa_data.ScaleHead.load(...)(features) with the features of its tables, or give "
            "`rsa-data predict` a photo"
        )
    return Reading(of, weights)([Scene(text=caption) for caption in captions])


def files(about: dict[str, Any], weights: Path | None = None) -> None:
    """Finds the files of a head's encoders or downloads them; raises as `Reading` does."""
    _checked(Features.of(about["features"]), weights)


def _checked(of: Features, weights: Path | None) -> list[tuple[Live, Input, Path | None]]:
    """Each input of a head with how it is made and the weights of its encoder."""
    inputs: list[Input] = [of, *(of.beside or [])]
    ways = []
    for name, one in zip(kinds_of(of), inputs, strict=True):
        if (live := kinds.kind(name).live) is None:
            raise UsageError(
                f"this head cannot be used on single photos: it reads {name} features of "
                f"{one.encoder}, which only `{kinds.kind(name).made_by}` makes, for a whole "
                "dataset. Measure it with `rsa-data evaluate`, or call rsa_data.ScaleHead"
                ".load(...)(features) with the features of its tables"
            )
        ways.append((live, one))
    if weights is None or len({one.encoder for one in inputs}) == 1:
        for live, one in ways:
            _check(live, one, weights)
        return [(live, one, weights) for live, one in ways]
    fits = [_fits(live, one, weights) for live, one in ways]
    if not any(fits):
        encoders = " and ".join(dict.fromkeys(str(one.encoder) for one in inputs))
        raise RsaDataError(
            f"--encoder-weights: expected a file of {encoders}, with which the head was trained; "
            f"found another one: {weights}"
        )
    found = [
        (live, one, weights if fit else None) for (live, one), fit in zip(ways, fits, strict=True)
    ]
    for live, one, own in found:
        _check(live, one, own)
    return found


def _fits(live: Live, one: Input, weights: Path) -> bool:
    try:
        _check(live, one, weights)
    except RsaDataError:
        return False
    return True


def _check(live: Live, one: Input, weights: Path | None) -> None:
    """Raises RsaDataError where a file is not the one that the head was trained with."""
    from ..common.digests import file_sha256

    for name, path in live.files(one.options or {}, weights).items():
        known = (one.files or {}).get(name)
        if known is not None and (found := file_sha256(str(path))) != known:
            raise RsaDataError(
                f"encoder {one.encoder}: the head was trained with another file {name}: expected "
                f"sha256 {known}; found {found} in {path.name}"
            )
