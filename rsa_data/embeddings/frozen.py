"""A frozen text encoder by its name: its files, and its network with the weights in memory."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from .. import registry
from ..common.digests import file_sha256
from ..common.errors import UsageError
from . import runtime
from .encoder import Encoder, Ids, TextModel
from .features import check_finite, gathered
from .running import Run
from .runtime import Device, Runtime

Chosen = Literal["float32", "float16", "bfloat16", "int8", "auto"]


def files(*, encoder: str, encoder_weights: Path | None = None, **_: object) -> dict[str, Path]:
    """The files whose bytes decide the features, by name; may download them."""
    if encoder_weights is not None and not encoder_weights.exists():
        raise UsageError(f"--encoder-weights: there is no file or folder at {encoder_weights}")
    return _encoder(encoder).files(registry.ENCODERS.split(encoder)[1] or None, encoder_weights)


def encode(texts: Sequence[str], **options: Any) -> np.ndarray:
    """Features of a few texts, float32 (n, dim), in torch; options as those of `loaded`."""
    return loaded(**options)(texts)


def loaded(
    *,
    encoder: str,
    encoder_weights: Path | None = None,
    normalize: bool = False,
    **others: object,
) -> Callable[[Sequence[str]], np.ndarray]:
    """A text encoder with its weights in memory; other options of a table do not matter to it."""
    run, model, _ = runners(encoder, encoder_weights, "float32", "torch", "cpu", 2)

    def encode(texts: Sequence[str]) -> np.ndarray:
        features = features_of(run, model, model.tokenize(list(texts))[0])
        check_finite(features, texts)
        return features / np.linalg.norm(features, axis=1, keepdims=True) if normalize else features

    return encode


def runners(
    encoder: str,
    encoder_weights: Path | None,
    precision: Chosen,
    wanted: Runtime,
    device: Device,
    threads: int,
) -> tuple[Run, TextModel, Run]:
    """Runs a model at the asked precision, the model, and the same in float32 for the audit.

    The arguments are the options of `embed`. Raises UsageError for a file that is not there, or a
    precision that the encoder is not run in.
    """
    if precision == "auto":
        precision = runtime.native_precision(wanted, device)
    where = runtime.choose(precision, wanted, device)
    paths = files(encoder=encoder, encoder_weights=encoder_weights)
    model = _encoder(encoder).loaded(paths, TextModel)
    return runtime.runners(model, _sources(encoder, paths), precision, where, threads)


def features_of(
    run: Run, model: TextModel, ids: Ids, done: Callable[[np.ndarray], object] | None = None
) -> np.ndarray:
    """Features of tokenized texts, float32 (n, dim), raw, in the order of `ids`.

    run, model : from `runners`. ids : the tokens of each text, from `model.tokenize`. done : is
    told the rows of each batch once they are there.

    Raises RsaDataError for an encoder that does not give each text's feature once.
    """
    batches = run(model.batches(ids, model.budget))
    return gathered(batches, np.ones(len(ids), bool), model.dim, done)


def _encoder(encoder: str) -> Encoder[TextModel]:
    name = registry.ENCODERS.split(encoder)[0]
    # Tables and heads keep what `hf:DIR` was as `hf-NAME`; where it lies comes with `weights`.
    found: Encoder[TextModel] = registry.resolve(
        "encoder", registry.ENCODERS, "hf" if name.startswith("hf-") else name
    )
    return found


def _sources(encoder: str, paths: dict[str, Path]) -> dict[str, str]:
    """What an encoder is made of: its name, code that is not this package's, and its files.

    Two encoders may share their files, or have none.
    """
    name, argument = registry.ENCODERS.split(encoder)
    about = {"encoder": "hf" if name.startswith("hf-") else name} | _code(name)
    digests = {f"file {key}": file_sha256(str(path)) for key, path in paths.items()}
    return about | digests | ({} if paths else {"argument": argument})


def _code(name: str) -> dict[str, str]:
    return {} if name.startswith("hf-") else registry.ENCODERS.source(name) or {}
