"""Heads that see too little, to tell what a head has learned beyond each dataset's average."""

from dataclasses import replace

import numpy as np

from ..inputs.vectors import Vectors
from .examples import Examples


def permutation(count: int, seed: int, part: int) -> np.ndarray:
    """Whose features each of `count` images of a part gets: int64 (count,), always the same."""
    return np.random.default_rng((seed, part)).permutation(count)


def controlled(examples: Examples, control: str, seed: int, part: int, datasets: int) -> Examples:
    """The examples of one part as a control head sees them.

    control : none, a real head; shuffled, each image gets what the head reads of another image of
    its dataset; dataset, the dataset's name, one-hot, in place of the features.
    part : number of the part. datasets : how many datasets the head is trained on.
    """
    if control == "shuffled":
        other = permutation(len(examples), seed, part)
        return replace(examples, inputs=tuple(block.take(other) for block in examples.inputs))
    if control == "dataset":
        names = Vectors(
            np.eye(datasets, dtype=np.float32), examples.dataset, np.arange(len(examples) + 1)
        )
        return replace(examples, inputs=(names,))
    return examples


def controlled_features(
    features: np.ndarray,
    there: np.ndarray,
    control: str,
    *,
    seed: int,
    part: int,
    dataset: str,
    datasets: list[str],
) -> np.ndarray:
    """Features of a part's images, (n, dim), as a control head sees them when it is measured.

    there : bool (n,), images that have a feature; only they are exchanged.
    dataset, datasets : the part's, and those that the head was trained on, in their order.
    """
    if control == "shuffled":
        rows = np.flatnonzero(there)
        features = features.copy()
        features[rows] = features[rows[permutation(len(rows), seed, part)]]
    elif control == "dataset":
        one = np.array([name == dataset for name in datasets], np.float32)
        features = np.broadcast_to(one, (len(features), len(one)))
    return features
