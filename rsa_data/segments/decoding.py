"""The seam between a detector's graph and the decoder families."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from .found import Found
from .preprocess import Geometry

# Role of an output in the card -> its array, with a batch of 1.
Outputs = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Decoder:
    """One family of models, with one model's settings.

    decode : outputs of one image and how it lies in the input -> what was found.
    roles : the outputs that it reads, with the number of axes and, where the number of classes
        decides it, the size that one axis must have: role -> (axes, axis, size) or (axes, 0, 1).
    batched : whether the first axis of every output is the batch; otherwise (suppression inside
        the graph) the outputs are those of one image, without a batch.
    """

    decode: Callable[[Outputs, Geometry], Found]
    roles: Mapping[str, tuple[int, int, int]]
    batched: bool = True


def sigmoid(values: np.ndarray) -> np.ndarray:
    """1 / (1 + exp(-x)), without overflow."""
    return 0.5 * (1 + np.tanh(0.5 * values))


def softmax(values: np.ndarray) -> np.ndarray:
    """Softmax over the last axis."""
    values = np.exp(values - values.max(-1, keepdims=True))
    shares: np.ndarray = values / values.sum(-1, keepdims=True)
    return shares
