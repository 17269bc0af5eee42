"""Encoders: frozen networks that turn a text or an image into one vector."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import torch

Ids = Sequence[Sequence[int]]
"""Tokens of each text, start and end included, cut at what the encoder reads."""

Batch = tuple[np.ndarray, dict[str, np.ndarray]]
"""Row numbers of the batch's texts, int of shape (b,), and the encoder's inputs by name."""


@dataclass(frozen=True)
class TextModel:
    """A text encoder with its weights.

    module : takes the inputs of a batch by name, returns features of shape (b, dim).
    tokenize : list of texts -> (Ids, bool of shape (n,), True where a text was cut).
    batches : (Ids, budget) -> batches that hold every text once; see encoders/batches.py.
    budget : the budget that runs fastest on a CPU, measured with benchmarks/embed.py.
    axes : for each input the names of its axes; axes of one name have one length.
    dim : length of a feature.
    normalized : whether features have norm 1 by the encoder's own definition.
    """

    module: "torch.nn.Module"
    tokenize: Callable[[list[str]], tuple[Ids, np.ndarray]]
    batches: Callable[[Ids, int], Iterator[Batch]]
    budget: int
    axes: dict[str, tuple[str, ...]]
    dim: int
    normalized: bool


@dataclass(frozen=True)
class TextEncoder:
    """An entry of registry.ENCODERS.

    files : (argument of `name:argument`, the user's --weights) -> the files whose bytes decide
        the features, by a name of their own; downloads what may be downloaded.
    load : those files -> TextModel.
    """

    files: Callable[[str | None, Path | None], dict[str, Path]]
    load: Callable[[dict[str, Path]], TextModel]
