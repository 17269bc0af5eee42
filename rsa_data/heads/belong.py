"""Which tables belong together: what a head's features and relative depth are made of."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..common.errors import RsaDataError, UsageError, unknown
from ..store import schemas
from ..store.tables import Table, WorkDir, fingerprint
from .train.examples import Source

# Options of a stage that change how fast or how exactly something is computed or kept, or which
# pixels are drawn, but not what it means.
_INDIFFERENT = ("threads", "store", "runtime", "device", "pixels", "seed")
# Options of the depth stage that may differ from dataset to dataset within one head: the paper's
# own models see NYU and KITTI images at different sizes.
_PER_DATASET = ("geometry", "crop")


def features_identity(table: Table) -> dict[str, Any]:
    """What features are: style, encoder, its options and the sha256 of its files."""
    description = table.description()
    _, style, encoder = table.name.split("/")
    options = {k: v for k, v in description.options.items() if k not in _INDIFFERENT}
    return {
        "style": style,
        "encoder": encoder,
        "options": options,
        "files": description.files,
        "stage_version": description.stage_version,
    }


def features_of(work: WorkDir, source: Source) -> dict[str, Any]:
    """What the features of a source are: of its table, or of both its tables one after another."""
    identity = features_identity(work.table(source.dataset, source.embeddings))
    if not source.images:
        return identity
    images = features_identity(work.table(source.dataset, source.images))
    return identity | {"encoder": f"{identity['encoder']}+{images['encoder']}", "images": images}


def width(table: Table, number: int) -> int:
    """Length of a feature of an embeddings table."""
    return schemas.embedding_array(table.read(number, ["embedding"]).slice(0, 1)).shape[1]


def depth_identity(table: Table) -> tuple[dict[str, Any], dict[str, Any]]:
    """What y is: (model, its options and files; the geometry this dataset's images had)."""
    description = table.description()
    options = {k: v for k, v in description.options.items() if k not in _INDIFFERENT}
    geometry = {key: options.pop(key, None) for key in _PER_DATASET}
    model = {
        "model": table.name.partition("/")[2],
        "options": options,
        "files": description.files,
        "stage_version": description.stage_version,
    }
    return model, geometry


def same(kind: str, found: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """The identity that all have; found: where -> identity. Raises RsaDataError otherwise.

    What is None in the first is not known there (an imported head) and goes with anything.
    """
    (first, identity), *others = found.items()
    for where, other in others:
        for key in identity.keys() | other.keys():
            mine, theirs = identity.get(key), other.get(key)
            if key == "options" and mine and theirs:
                # An option that a head does not know of came after it, or was not told.
                theirs = {name: theirs.get(name) for name in mine}
            if mine is not None and mine != theirs:
                raise RsaDataError(
                    f"{kind} that do not belong together: {key} is {mine!r} in "
                    f"{first} and {theirs!r} in {where}. Make them again with the same "
                    "options, or train on one dataset at a time with --datasets"
                )
    return identity


def sources(
    work: WorkDir,
    datasets: Sequence[str],
    style: str | None,
    encoder: str | None,
    depth_model: str | None,
) -> list[Source]:
    """The tables to learn from, one entry a dataset; what is not named must be the only one there.

    encoder : of texts; of images, with the style images; or both as TEXT+IMAGE.

    Raises UsageError when a choice is open, RsaDataError when a table is missing.
    """
    there = work.datasets()
    for name in datasets:
        if name not in there:
            raise unknown("dataset in this work dir", name, there)
    if not there:
        raise RsaDataError(
            f"{work.store.location}: no dataset there yet. Begin with "
            "`rsa-data captions --dataset NAME`, or name another --work"
        )
    found = []
    encoder, _, beside = (encoder or "").partition("+")
    for name in datasets or there:
        names = work.tables(name)
        features = [t.split("/") for t in names if t.startswith("embeddings/")]
        _, style_, encoder_ = _only(
            name,
            "embeddings",
            [t for t in features if _matches(t, style, encoder, beside)],
            "--style and --encoder",
            "rsa-data embed",
        )
        # Image features stand beside the styles of text, and have no captions.
        captions = "" if style_ in ("images", "proposals") else f"captions/{style_}"
        depths = [t.split("/") for t in names if t.startswith("depth/")]
        _, depth_ = _only(
            name,
            "depth",
            [t for t in depths if depth_model in (None, t[1])],
            "--depth-model",
            f"rsa-data depth --dataset {name}",
        )
        images = f"embeddings/images/{beside}" if beside else ""
        if images and images not in names:
            raise RsaDataError(
                f"{name}: no such table {images}. Make it first: rsa-data embed-images"
            )
        embeddings = f"embeddings/{style_}/{encoder_}"
        found.append(Source(name, captions, embeddings, f"depth/{depth_}", images))
    return found


def _matches(table: list[str], style: str | None, encoder: str, beside: str) -> bool:
    _, own_style, own_encoder = table
    if beside and own_style in ("images", "proposals"):
        return False
    return style in (None, own_style) and encoder in ("", own_encoder)


def _only(dataset: str, kind: str, found: list[list[str]], by: str, make: str) -> list[str]:
    if not found:
        raise RsaDataError(f"{dataset}: no such {kind} table. Make it first: {make}")
    if len(found) > 1:
        names = ", ".join("/".join(name[1:]) for name in found)
        raise UsageError(f"{dataset}: several {kind} tables; say which by {by}: {names}")
    return found[0]


def current(work: WorkDir, source: Source, number: int) -> dict[str, str]:
    """Digests of the part in each table of a source, by table.

    Raises RsaDataError when a table has no such part yet, or made it from another part than the
    one that lies there now.
    """
    names = ["samples", source.captions, source.embeddings, source.images, source.depth]
    receipts = {name: work.table(source.dataset, name).receipt(number) for name in names if name}
    for name, receipt in receipts.items():
        for input_name, digest in receipt.inputs.items():
            if input_name in receipts and receipts[input_name].digest != digest:
                raise RsaDataError(
                    f"{source.dataset}/{name} part {number} was made from another {input_name} "
                    "part than the one that lies there now: run its stage again"
                )
    return {name: receipt.digest for name, receipt in receipts.items()}


def together(digests: list[dict[str, str]]) -> dict[str, str]:
    """One digest a table of the digests of its parts, in the order given."""
    return {name: fingerprint([part[name] for part in digests]) for name in digests[0]}


def encode(features: dict[str, Any], captions: Sequence[str], weights: Any = None) -> np.ndarray:
    """Features of captions, (n, dim), by the encoder that a head was trained on.

    features : `features` of head.json. weights : the encoder's file, where it is not found alone.
    """
    return encoder(features, weights)(captions)


def encoder(features: dict[str, Any], weights: Any = None) -> Callable[[Sequence[str]], np.ndarray]:
    """`encode` with the encoder in memory; raises RsaDataError when it is not the head's."""
    from ..common.digests import file_sha256
    from ..embeddings import embed

    if features.get("style") in ("images", "proposals") or "images" in features:
        raise UsageError(
            f"this head reads {features['style']} features of {features['encoder']}, not captions "
            "alone: call rsa_data.ScaleHead.load(...)(features) with the features of its tables"
        )
    options = {**features["options"], "encoder_weights": weights}
    paths = embed.files(**options)
    for name, path in paths.items():
        known = (features["files"] or {}).get(name)
        if known is not None and (found := file_sha256(str(path))) != known:
            raise RsaDataError(
                f"encoder {features['encoder']}: the head was trained with another file {name}: "
                f"expected sha256 {known}; found {found} in {path.name}"
            )
    return embed.loaded(**options)
