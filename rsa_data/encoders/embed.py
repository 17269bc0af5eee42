"""The stage embed: every distinct text of a captions part through a frozen encoder, once."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from .. import progress, registry, tables
from ..errors import RsaDataError, UsageError
from . import TextEncoder

Step = Callable[[pa.Table], pa.Table]


def build(
    *,
    encoder: str = "clip-rn50",
    weights: Path | None = None,
    store: Literal["float16", "float32"] = "float16",
    normalize: bool = False,
    threads: int = 2,
) -> Step:
    """Turns texts into features with a frozen text encoder.

    Parameters
    ----------
    encoder : text encoder; see `rsa-data list encoders`.
    weights : file with the encoder's weights, or folder of a sentence encoder. Without it the
        registry's file is taken: from its package, the cache, or a download with its checksum.
    store : type of the stored features; they are computed in float32. float16 rounds each value
        by up to 4.9e-4 of itself.
    normalize : scale each feature to norm 1; the paper's heads want CLIP's features raw. An
        encoder whose own definition ends in a normalisation has it in any case.
    threads : CPU threads of each worker; they can change the last bits of a feature.
    """
    import torch

    torch.set_num_threads(threads)
    model = _encoder(encoder).load(files(encoder=encoder, weights=weights))

    def run(inputs: dict[str, np.ndarray]) -> np.ndarray:
        with torch.inference_mode():
            return model.module(**{k: torch.from_numpy(v) for k, v in inputs.items()}).numpy()

    def step(captions: pa.Table) -> pa.Table:
        text_id, texts = distinct_texts(captions)
        ids, truncated = model.tokenize(texts)
        lengths = np.array([len(row) for row in ids], np.int32)
        features = np.empty((len(texts), model.dim), np.float32)
        told = _Progress(len(pc.unique(captions["sample_id"])), int(lengths.sum()))
        for rows, inputs in model.batches(ids, model.budget):
            features[rows] = run(inputs)
            told.add(int(lengths[rows].sum()))
        if normalize:
            features /= np.linalg.norm(features, axis=1, keepdims=True)
        stored = features.astype(store)
        if not np.isfinite(stored).all():
            row = int(np.flatnonzero(~np.isfinite(stored).all(1))[0])
            raise RsaDataError(
                f"embed: the feature of {texts[row][:60]!r} is not finite in {store}: expected "
                "values of about -50 to 50. Are the weights damaged?"
            )
        return tables.from_columns(
            "embeddings",
            {
                "text_id": text_id,
                "embedding": tables.embedding_column(stored),
                "n_tokens": lengths,
                "truncated": truncated,
            },
        )

    return step


def files(
    *, encoder: str = "clip-rn50", weights: Path | None = None, **_: object
) -> dict[str, Path]:
    """The files whose bytes decide the features, by name; may download them."""
    if weights is not None and not weights.exists():
        raise UsageError(f"--weights: expected a file or folder; {weights} is not there")
    return _encoder(encoder).files(encoder.partition(":")[2] or None, weights)


def _encoder(encoder: str) -> TextEncoder:
    return registry.resolve("encoder", registry.ENCODERS, encoder.partition(":")[0])


class _Progress:
    """Tells progress in samples, as the frame counts, from tokens, which the time goes with."""

    def __init__(self, samples: int, tokens: int):
        self.samples, self.tokens, self.done, self.told = samples, max(1, tokens), 0, 0

    def add(self, tokens: int) -> None:
        self.done += tokens
        now = self.samples * self.done // self.tokens
        progress.advance(now - self.told)
        self.told = now


def distinct_texts(captions: pa.Table) -> tuple[pa.Array, list[str]]:
    """Ids and texts of a captions part, each once, in order of first appearance."""
    encoded = captions["text_id"].combine_chunks().dictionary_encode()
    # Codes are numbered by first appearance, so the first row of each code is in that order.
    first = np.unique(encoded.indices.to_numpy(), return_index=True)[1]
    texts = captions["text"].take(pa.array(first)).combine_chunks()
    try:
        return encoded.dictionary, texts.to_pylist()
    except UnicodeDecodeError as error:
        start = error.object[:60]
        raise RsaDataError(f"captions: text: expected UTF-8, found {start!r}") from error
