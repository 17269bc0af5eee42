"""Encoders: frozen networks that turn a text or an image into one vector."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import torch

Tokens = tuple[Sequence[Sequence[int]], np.ndarray]
"""ids of each text (start and end included, cut at what the encoder reads), and bool of shape
(n,), True where a text was cut."""


@dataclass(frozen=True)
class TextModel:
    """A text encoder with its weights.

    module : maps ids, int64 of shape (b, t), padded at the end with `pad`, and lengths, int64 of
        shape (b,), to features of shape (b, dim). What stands behind a text's length must not
        change its feature.
    tokenize : list of texts -> Tokens.
    dim : length of a feature.
    normalized : whether the module's features have norm 1 by the model's own definition.
    pad : id that fills a batch.
    """

    module: "torch.nn.Module"
    tokenize: Callable[[list[str]], Tokens]
    dim: int
    normalized: bool
    pad: int = 0


@dataclass(frozen=True)
class TextEncoder:
    """An entry of registry.ENCODERS.

    files : (argument of `name:argument`, the user's --weights) -> the files whose bytes decide
        the features, by a name of their own; downloads what may be downloaded.
    load : those files -> TextModel.
    """

    files: Callable[[str | None, Path | None], dict[str, Path]]
    load: Callable[[dict[str, Path]], TextModel]
