"""Encoders: frozen networks that turn a text or an image into one vector."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

from ..common.errors import UsageError
from ..common.pretrained import Ids as Ids

if TYPE_CHECKING:
    import torch

Batch = tuple[np.ndarray, dict[str, np.ndarray]]
"""Row numbers of the batch's texts, int of shape (b,), and the encoder's inputs by name."""


@dataclass(frozen=True)
class TextModel:
    """A text encoder with its weights.

    network : makes the module that takes the inputs of a batch by name and returns features of
        shape (b, dim). Called only where torch runs it, or a graph is made of it.
    tokenize : list of texts -> (Ids, bool of shape (n,), True where a text was cut).
    batches : (Ids, budget) -> batches that hold every text once; see encoders/batches.py.
    budget : the budget that runs fastest on a CPU, measured with benchmarks/embed.py.
    axes : for each input the names of its axes; axes of one name have one length.
    dim : length of a feature.
    normalized : whether features have norm 1 by the encoder's own definition.
    no_int8 : why it is not run in int8, with figures; "" where it is.
    """

    network: Callable[[], "torch.nn.Module"]
    tokenize: Callable[[list[str]], tuple[Ids, np.ndarray]]
    batches: Callable[[Ids, int], Iterator[Batch]]
    budget: int
    axes: dict[str, tuple[str, ...]]
    dim: int
    normalized: bool
    no_int8: str = ""

    @cached_property
    def module(self) -> "torch.nn.Module":
        """What `network` makes, once."""
        return self.network()


@dataclass(frozen=True)
class ImageModel:
    """An image encoder with its weights.

    module : takes `pixels`, float32 of shape (b, 3, height, width), returns (b, dim).
    prepare : uint8 of shape (h, w, 3), RGB -> float32 of shape (3, height, width).
    dim : length of a feature, which is not normalised.
    """

    module: "torch.nn.Module"
    prepare: Callable[[np.ndarray], np.ndarray]
    dim: int


Model = TypeVar("Model", TextModel, ImageModel)


@dataclass(frozen=True)
class Encoder(Generic[Model]):
    """An entry of registry.ENCODERS (of TextModel) or IMAGE_ENCODERS (of ImageModel).

    doc : one line for `rsa-data list`.
    files : (argument of `name:argument`, the user's file) -> the files whose bytes decide
        the features, by a name of their own; downloads what may be downloaded.
    load : those files -> the model.
    """

    doc: str
    files: Callable[[str | None, Path | None], dict[str, Path]]
    load: Callable[[dict[str, Path]], Model]

    def loaded(self, files: dict[str, Path], kind: type[Model]) -> Model:
        """What `load` gives; raises UsageError where it is a model of another kind."""
        model = self.load(files)
        if not isinstance(model, kind):
            raise UsageError(
                f"encoder ({self.doc}): expected a {kind.__name__}; found {type(model).__name__}: "
                "it is listed as an encoder of the other kind, texts or images"
            )
        return model

    def __post_init__(self) -> None:
        # `rsa-data list` shows the documentation of what a name stands for.
        object.__setattr__(self, "__doc__", self.doc)
