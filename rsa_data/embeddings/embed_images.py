"""The stage embed-images: every image of a part through a frozen image encoder."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa

from .. import registry
from ..common import progress
from ..common.errors import RowError, RsaDataError, UsageError
from ..common.options import accepts_old_names
from ..common.prefetch import ahead
from ..common.ranges import AtOnce
from ..datasets.images import read_image
from ..datasets.roots import readers
from ..datasets.shards import name_of
from ..runner.stage import Stage
from ..store import schemas
from . import runtime as runtimes
from .encoder import Batch, Encoder, ImageModel
from .features import gathered, stored
from .running import in_torch
from .runtime import Device

Step = Callable[[pa.Table], pa.Table]

# Images of a batch: enough for the convolutions to run at full rate, 10 MB of pixels.
_BATCH = 16


@accepts_old_names("embed-images")
def build(
    *,
    root: Path | None,
    encoder: str = "clip-rn50",
    encoder_weights: Path | None = None,
    precision: Literal["float32", "float16", "bfloat16"] = "float32",
    store: Literal["float16", "float32"] = "float16",
    device: Device = "auto",
    threads: AtOnce = 2,
) -> Step:
    """Turns images into features with a frozen image encoder.

    Parameters
    ----------
    encoder : image encoder; see `rsa-data list image-encoders`.
    encoder_weights : file with the encoder's weights, or a model's folder, instead of the download.
    precision : arithmetic of the encoder.
    store : type of the stored features; float16 rounds each value by up to 4.9e-4 of itself.
    device : where the encoder runs; auto takes a GPU when there is one.
    threads : CPU threads of each worker; they can change the last bits of a feature.
    """
    import torch

    if root is None:
        raise UsageError("embed-images: expected the dataset's images; give --root DIR")
    torch.set_num_threads(threads)
    _, on = runtimes.choose(precision, "torch", device)
    model = _loaded(encoder, encoder_weights)
    run = in_torch(model.module, precision, on)

    def step(samples: pa.Table) -> pa.Table:
        images = samples["image"].to_pylist()
        errors: list[str | None] = [None] * len(images)
        read = np.zeros(len(images), bool)
        batches = _batches(images, root, model, errors, read)
        features = gathered(run(batches), read, model.dim)
        good = np.isfinite(features).all(1) & features.any(1)
        if read.any() and not good.any():
            first = images[int(np.flatnonzero(read)[0])]
            raise RsaDataError(
                f"embed-images: expected finite features that are not all zero; found none from "
                f"{first} on. Are the weights damaged?"
            )
        for row in np.flatnonzero(read & ~good).tolist():
            features[row] = 0
            errors[row] = f"{name_of(images[row] or '')}: its feature is not finite, or all zero"
        status = [
            "skipped" if image is None else "failed" if error else "ok"
            for image, error in zip(images, errors, strict=True)
        ]
        ok = np.array([s == "ok" for s in status], bool)
        return schemas.from_columns(
            "image_embeddings",
            {
                "sample_id": samples["sample_id"],
                "status": status,
                "error": [
                    "no image is listed" if image is None else error
                    for image, error in zip(images, errors, strict=True)
                ],
                "embedding": embedding_column_with_nulls(stored(features, store), ok),
            },
        )

    return step


def files(
    *, encoder: str = "clip-rn50", encoder_weights: Path | None = None, **others: object
) -> dict[str, Path]:
    """The files whose bytes decide the features, by name; may download them."""
    if encoder_weights is not None and not encoder_weights.exists():
        raise UsageError(f"--encoder-weights: there is no file or folder at {encoder_weights}")
    argument = registry.IMAGE_ENCODERS.split(encoder)[1]
    return _encoder(encoder).files(argument or None, encoder_weights)


def loaded(
    *, encoder: str, encoder_weights: Path | None = None
) -> Callable[[Sequence[np.ndarray]], np.ndarray]:
    """An image encoder with its weights in memory: images, uint8 (h, w, 3), RGB -> `encode`."""
    model = _loaded(encoder, encoder_weights)
    run = in_torch(model.module, "float32", "cpu")

    def encode(images: Sequence[np.ndarray]) -> np.ndarray:
        pixels = np.stack([model.prepare(image) for image in images])
        found = run(iter([(np.arange(len(images)), {"pixels": pixels})]))
        return gathered(found, np.ones(len(images), bool), model.dim)

    return encode


def encode(
    images: Sequence[np.ndarray], *, encoder: str, encoder_weights: Path | None = None
) -> np.ndarray:
    """Features of a few images, uint8 (h, w, 3), RGB: float32 (n, dim)."""
    return loaded(encoder=encoder, encoder_weights=encoder_weights)(images)


def _loaded(encoder: str, weights: Path | None) -> ImageModel:
    paths = files(encoder=encoder, encoder_weights=weights)
    return _encoder(encoder).loaded(paths, ImageModel)


def _encoder(encoder: str) -> Encoder[ImageModel]:
    name = registry.IMAGE_ENCODERS.split(encoder)[0]
    found: Encoder[ImageModel] = registry.resolve("image encoder", registry.IMAGE_ENCODERS, name)
    return found


def _batches(
    images: list[str | None],
    root: Path,
    model: ImageModel,
    errors: list[str | None],
    good: np.ndarray,
) -> Iterator[Batch]:
    """Batches of readable images, which become True in `good`; others leave their reason in
    `errors`."""
    rows: list[int] = []
    pixels: list[np.ndarray] = []

    def read(image: str | None) -> np.ndarray | None:
        return None if image is None else model.prepare(read_image(root / image))

    with ThreadPoolExecutor(readers(root)) as pool:
        for row, found in enumerate(ahead(pool, read, images, _BATCH)):
            if isinstance(found, RowError):
                errors[row] = f"{name_of(images[row] or '')}: {found}"
            elif found is not None:
                pixels.append(found)
                rows.append(row)
                good[row] = True
            progress.advance(1)
            if len(rows) == _BATCH:
                yield np.array(rows), {"pixels": np.stack(pixels)}
                rows, pixels = [], []
    if rows:
        yield np.array(rows), {"pixels": np.stack(pixels)}


def embedding_column_with_nulls(features: np.ndarray, ok: np.ndarray) -> tuple[pa.Field, pa.Array]:
    """An embedding column that is null where a row is not ok."""
    field, array = schemas.embedding_column(features)
    valid: Any = pa.py_buffer(np.packbits(ok, bitorder="little").tobytes())
    nulls = int((~ok).sum())
    array = pa.Array.from_buffers(
        array.type, len(array), [valid if nulls else None, array.buffers()[1]], nulls
    )
    return field.with_nullable(True), array


STAGE = Stage(
    name="embed-images",
    version=2,
    build=build,
    help="""Turn images into embeddings.

    Heads that learn from images read them.

    \b
      rsa-data embed-images --dataset nyuv2 --encoder clip-rn50
      rsa-data embed-images --dataset nyuv2 --encoder hf:openai/clip-vit-large-patch14-336
    """,
    next="train-head --style images",
    schema="image_embeddings",
    folder="embeddings/images",
    selector="encoder",
    models=True,
    choices=registry.IMAGE_ENCODERS,
    local=("encoder_weights",),
    files=files,
)
