"""What a notebook calls without a work dir: write captions, embed texts, predict depth.

Arrays and lists go in and come out.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from ..common.errors import UsageError
from ..store import schemas

if TYPE_CHECKING:
    import pyarrow.dataset

    from ..heads.checkpoint import ScaleHead


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
    from ..common import entries
    from ..common.options import call

    entries.allow([style])
    found = [[_segment(s) for s in image] for image in segments]
    ids = [f"notebook/train/{k}" for k in range(len(found))]
    asked = {"style": style, "variants": variants, "seed": seed, **options}
    step = call(write.build, **asked)
    texts = step(_segments_table(ids, found), _samples_table(ids))["text"].to_pylist()
    return [texts[k * variants : (k + 1) * variants] for k in range(len(found))]


def embed_texts(
    texts: Sequence[str], *, encoder: str = "clip-rn50", encoder_weights: Path | None = None
) -> np.ndarray:
    """Features of texts, float32 (n, dim), raw, as `rsa-data embed` computes them.

    encoder : a name of `rsa-data list encoders`, or `module:attribute` of your own.
    encoder_weights : file or folder of its weights, instead of the download.
    """
    from ..common import entries
    from ..embeddings import embed

    entries.allow([encoder])
    if isinstance(texts, str):
        raise UsageError("embed_texts: expected a list of texts, found one text")
    if not len(texts):
        raise UsageError("embed_texts: expected at least one text, found none")
    return embed.encode(list(texts), encoder=encoder, encoder_weights=encoder_weights)


def predict_depth(
    image: np.ndarray | str | os.PathLike[str],
    *,
    head: ScaleHead | str | os.PathLike[str],
    caption: str | None = None,
    relative: np.ndarray | None = None,
    segments: str | None = None,
    segmenter_weights: Path | None = None,
    encoder_weights: Path | None = None,
    depth_weights: Path | None = None,
) -> np.ndarray:
    """Metric depth of one image, float32 (height, width), m; inf where it is beyond everything.

    Parameters
    ----------
    image : uint8 (height, width, 3), RGB, or an image file.
    head : a ScaleHead, or the folder that holds one, such as work/heads/NAME.
    caption : what the image shows, instead of a caption from the head's segmenter.
    relative : float (height, width), raw output of the head's depth model, instead of running it.
    segments, segmenter_weights : the segmenter, and the file of its weights.
    encoder_weights, depth_weights : files of the text encoder's and the depth model's weights.
    """
    from PIL import Image

    from ..datasets.images import image_size, read_image
    from ..heads.checkpoint import ScaleHead
    from ..heads.metric import to_metric
    from ..heads.predict.asking import Asking
    from ..heads.predict.choices import Models
    from ..heads.predict.images import describer, relative_map, relative_source

    if not isinstance(head, ScaleHead):
        head = ScaleHead.load(os.fspath(head))
    about = head.description
    models = Models(
        segments=segments, segmenter_weights=segmenter_weights, depth_weights=depth_weights
    )
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
            place = Path(image)
        ask = Asking(head, encoder_weights)
        found, own = None, caption
        if caption is None and ask.kinds != ("image",):
            found, own = describer(about, place.parent, models)(place.name)
        said = ask(own, found, read_image(place) if "image" in ask.kinds else None)
        if relative is None:
            width, height = image_size(place)
            source = relative_source(about, place.parent, models)
            relative = relative_map(source, place.name, (height, width))
    depth: np.ndarray = to_metric(np.asarray(relative), said.scale, said.shift)
    return depth


def _segment(given: Mapping[str, Any] | tuple[str, float]) -> dict[str, Any]:
    """One object with every field that it may have."""
    known = {"score": 1.0, "is_thing": True, "box": None}
    if isinstance(given, Mapping):
        strange = set(given) - {"label", "area", *known}
        if strange or not {"label", "area"} <= set(given):
            raise UsageError(
                "write_captions: expected label, area and maybe box, score and is_thing; found "
                f"{', '.join(given)}"
            )
        return {**known, **given}
    label, area = given
    return {**known, "label": label, "area": area}


def _segments_table(ids: list[str], images: list[list[dict[str, Any]]]) -> pa.Table:
    n = len(ids)
    boxes = [[s["box"] for s in image] for image in images]
    columns: dict[str, Any] = {name: [None] * n for name in schemas.schema("segments").names}
    columns |= {"sample_id": ids, "status": ["ok"] * n}
    columns |= {
        name: [[s[name] for s in image] for image in images]
        for name in ("label", "score", "area", "is_thing")
    }
    columns["box"] = [None if any(b is None for b in found) else found for found in boxes]
    columns["center"] = [
        None if b is None else [((x0 + x1) / 2, (y0 + y1) / 2) for x0, y0, x1, y1 in b]
        for b in columns["box"]
    ]
    return schemas.from_columns("segments", columns)


def _samples_table(ids: list[str]) -> pa.Table:
    n = len(ids)
    columns: dict[str, Any] = {name: [None] * n for name in schemas.schema("samples").names}
    columns |= {"sample_id": ids, "dataset": ["notebook"] * n, "split": ["train"] * n}
    return schemas.from_columns("samples", columns | {"scene": ["."] * n})
