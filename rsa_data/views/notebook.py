"""What a notebook calls without a work dir: write captions, embed texts, predict depth.

Arrays and lists go in and come out.
"""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..common import calls
from ..common.calls import in_python
from ..common.errors import RowError, RsaDataError, UsageError, unknown
from .notebook_tables import objects, samples_table, segments_table

if TYPE_CHECKING:
    from ..heads.checkpoint import ScaleHead


@in_python
def write_captions(
    segments: Sequence[Sequence[Mapping[str, Any] | tuple[str, float]]],
    *,
    style: str = "occupancy",
    variants: int = 1,
    seed: int = 0,
    **options: Any,
) -> list[list[str]]:
    """Captions of images from what they show, as `rsa-data captions` writes them.

    Parameters
    ----------
    segments : for each image its objects: (label, area) or a mapping with `label`, `area` (share of
        the image, 0 to 1) and, where the style needs them, `box` (x1, y1, x2, y2 in px), `score`
        and `is_thing`.
    style : a wording of `rsa-data list styles`, or `module:attribute` of your own.
    variants : captions of each image; the first is the plain one.
    seed : of the other variants, which leave objects out or change their order.
    options : other options of `rsa-data captions`, such as `digits` or `tokenizer`.

    Returns a list of `variants` texts for each image.
    """
    from ..captions import write
    from ..common import own_code
    from ..common.options import bind, call

    own_code.allow([calls.text("write_captions: style", style)])
    variants = calls.whole("write_captions: variants", variants, 1)
    found = [objects(place, image) for place, image in enumerate(segments)]
    ids = [f"notebook/train/{k}" for k in range(len(found))]
    asked = {"style": style, "variants": variants, "seed": seed, **options}
    step = call(write.build, **bind(write.build, asked, "write_captions"))
    texts = step(segments_table(ids, found), samples_table(ids))["text"].to_pylist()
    return [texts[k * variants : (k + 1) * variants] for k in range(len(found))]


@in_python
def embed_texts(
    texts: Sequence[str],
    *,
    encoder: str = "clip-rn50",
    encoder_weights: str | os.PathLike[str] | None = None,
) -> np.ndarray:
    """Features of texts, float32 (n, dim), raw, computed in float32 on the CPU.

    Those of a table differ by its rounding: by up to 4.9e-4 of a value where it is stored as
    float16, by a few thousandths where `rsa-data embed` ran in bfloat16.

    encoder : a name of `rsa-data list encoders`, or `module:attribute` of your own.
    encoder_weights : file or folder of its weights, instead of the download.
    """
    from ..common import own_code
    from ..embeddings import frozen

    own_code.allow([calls.text("embed_texts: encoder", encoder)])
    found = calls.texts("embed_texts", texts)
    weights = calls.path("embed_texts: encoder_weights", encoder_weights)
    return frozen.encode(found, encoder=encoder, encoder_weights=weights)


@in_python
def predict_depth(
    image: np.ndarray | str | os.PathLike[str],
    *,
    head: ScaleHead | str | os.PathLike[str] | None = None,
    caption: str | None = None,
    relative: np.ndarray | None = None,
    known: Sequence[tuple[float, float, float]] = (),
    **models: Any,
) -> np.ndarray:
    """Metric depth of one image, float32 (height, width), m; inf where it is beyond everything.

    Parameters
    ----------
    image : uint8 (height, width, 3), RGB, or an image file.
    head : a ScaleHead, or the folder that holds one, such as work/heads/NAME; None where known
        distances are enough.
    caption : what the image shows, instead of a caption from the head's segmenter.
    relative : float (height, width), raw output of the head's depth model at the image's own size,
        instead of running it.
    known : points of known depth, (column, row, metres), of the image as it is shown, from the top
        left; used as `rsa-data predict --known`. Without a head two or more give scale and shift,
        one the scale alone; with a head they correct it.
    models : the models and files of their weights as options of `rsa-data predict`: segments,
        segmenter_weights, card, style, encoder_weights, depth_model, depth_weights, depth_card.

    Warns (UserWarning) where known points contradict each other, the head or the relative depth,
    and of what had to be assumed. Raises RsaDataError where a model is missing, UsageError for an
    argument of another kind.
    """
    from PIL import Image

    from ..datasets.images import image_size, read_image
    from ..heads.checkpoint import ScaleHead
    from ..heads.predict.asking import Asking
    from ..heads.predict.choices import Hints, Models
    from ..heads.predict.depth_model import depth_of
    from ..heads.predict.images import describer, relative_map, relative_source
    from ..heads.predict.prediction import Prediction
    from ..heads.predict.run import in_metres

    hints = Hints(known=_known(known))
    if head is None and not hints:
        raise UsageError("predict_depth: expected a head, or known=[(u, v, metres), ...]")
    of_head = ("segments", "segmenter_weights", "card", "style", "encoder_weights")
    for name in ("caption", *of_head) if head is None else ():
        if ({"caption": caption} | models).get(name) is not None:
            raise UsageError(f"predict_depth: {name}: it has no effect without a head")
    if head is not None and not isinstance(head, ScaleHead):
        head = ScaleHead.load(os.fspath(head) if isinstance(head, os.PathLike) else head)
    if caption is not None:
        calls.text("predict_depth: caption", caption)
    about: dict[str, Any] = {} if head is None else head.description
    chosen = Models(**_models(models))
    with tempfile.TemporaryDirectory() as folder:
        if isinstance(image, np.ndarray):
            if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
                raise UsageError(
                    "predict_depth: image: expected uint8 (height, width, 3), RGB; found "
                    f"{image.dtype} {image.shape}"
                )
            place = Path(folder) / "image.png"
            Image.fromarray(image).save(place)
        else:
            place = Path(calls.path("predict_depth: image", image) or "")
        try:
            width, height = image_size(place)
        except RowError as error:
            raise RsaDataError(f"predict_depth: image {place}: {error}") from error
        if relative is not None:
            relative = _relative(relative, (height, width))
        else:
            try:
                depth_of(about, chosen)
            except UsageError as error:
                raise UsageError(
                    "predict_depth: relative: expected the image's relative depth, float "
                    f"{height, width}; found none, and no depth model to make it: "
                    f"{str(error).removeprefix('predict: ')}"
                ) from error
        said = Prediction(None)
        if head is not None:
            ask = Asking(head, chosen.encoder_weights, chosen.style)
            found, own = None, caption
            if caption is None and ask.kinds != ("image",):
                found, own = describer(about, place.parent, chosen)(place.name)
            said = ask(own, found, read_image(place) if "image" in ask.kinds else None)
        if relative is None:
            source = relative_source(about, place.parent, chosen)
            relative = relative_map(source, place.name, (height, width))
    said.warnings, said.image = [], None
    in_metres(said, relative, hints, about)
    assert said.depth is not None
    for text in said.warnings if hints else ():
        warnings.warn(text, stacklevel=3)
    return said.depth


def _known(given: Any) -> tuple[str, ...]:
    """Known points as the command line writes them, checked."""
    try:
        return tuple(
            ",".join(f"{float(value):.12g}" for value in (u, v, metres)) for u, v, metres in given
        )
    except (TypeError, ValueError):
        raise UsageError(
            "predict_depth: known: expected (column, row, metres) of each point; found "
            f"{given!r:.80}"
        ) from None


def _models(given: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of `Models` by name, checked."""
    from ..heads.predict.choices import Models

    kinds = {field.name: str(field.type) for field in fields(Models) if field.name != "relative"}
    found: dict[str, Any] = {}
    for name, value in given.items():
        if name not in kinds:
            raise UsageError(f"predict_depth: {unknown('argument', name, kinds)}")
        check = calls.path if "Path" in kinds[name] else calls.text
        found[name] = None if value is None else check(f"predict_depth: {name}", value)
    return found


def _relative(given: Any, size: tuple[int, int]) -> np.ndarray:
    """Relative depth that was given, float32 (height, width), of an image of this size."""
    told = f"predict_depth: relative: expected float {size}, the image's height and width"
    found = np.asarray(given)
    if found.dtype.kind not in "fiu":
        raise UsageError(f"{told}; found {type(given).__name__} of {found.dtype}")
    if found.shape != size:
        raise UsageError(f"{told}; found the shape {found.shape}")
    if not np.isfinite(found).any():
        raise UsageError(f"{told}; found no finite value in it")
    return found.astype(np.float32)
