"""Batches of an epoch: images drawn from all datasets together, or some of each in every step."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple, Protocol

import numpy as np
import torch

from ..architectures.layers import Head
from .examples import Examples
from .plan import Batches


class Batch(NamedTuple):
    """Some images: what the head reads of them, float32 (b, dim), and their pixels, (b, k).

    y, true : relative and metric depth, m. fit : (b, 2), see `Examples`. share, dataset : (b,).
    """

    x: torch.Tensor
    y: torch.Tensor
    true: torch.Tensor
    fit: torch.Tensor
    share: torch.Tensor
    dataset: torch.Tensor

    def __len__(self) -> int:
        return len(self.dataset)


class Standard(Protocol):
    """Mean and 1 / spread of the features, each float32 (dim,)."""

    mean: torch.Tensor
    factor: torch.Tensor


def images_in_an_epoch(images: np.ndarray, batch: int, how: Batches) -> int:
    """How many images an epoch shows. images : of each dataset."""
    if how == "mixed":
        return int(images.sum())
    steps = -(-int(images.min()) // batch)
    return int(np.minimum(images, steps * batch).sum())


def batches(
    window: Examples,
    standard: Standard,
    network: Head,
    *,
    size: int,
    pixels: int,
    how: Batches,
    generator: torch.Generator,
) -> Iterator[Batch]:
    """Batches of one epoch over one window, with a caption variant and a run of pixels drawn anew.

    size : images in a batch, with `each` of every dataset. pixels : of each image; 0 for all.
    """
    relative, metric = torch.from_numpy(window.relative), torch.from_numpy(window.metric)
    fits, dataset = torch.from_numpy(window.fit), torch.from_numpy(window.dataset)
    share = torch.from_numpy(window.share)
    pixels = pixels or relative.shape[1]
    order = torch.randperm(len(window), generator=generator)
    drawn = torch.rand(len(window), generator=generator, dtype=torch.float64).numpy()
    for images in _mixed(order, size) if how == "mixed" else _of_each(order, dataset, size):
        # Pixels are stored in random order, so any run of them is a random sample.
        runs = max(1, relative.shape[1] // pixels)
        start = pixels * int(torch.randint(runs, (1,), generator=generator))
        taken = slice(start, start + pixels)
        x = torch.from_numpy(window.rows(images.numpy(), drawn[images.numpy()]))
        yield Batch(
            network.centred(x.float(), standard.mean, standard.factor),
            relative[images, taken].float(),
            metric[images, taken].float(),
            fits[images],
            share[images],
            dataset[images],
        )


def _mixed(order: torch.Tensor, size: int) -> Iterable[torch.Tensor]:
    """Every image once."""
    return torch.split(order, size)


def _of_each(order: torch.Tensor, dataset: torch.Tensor, size: int) -> Iterator[torch.Tensor]:
    """Images of every dataset side by side, until the smallest has been seen."""
    own = [torch.split(order[dataset[order] == d], size) for d in torch.unique(dataset)]
    for several in zip(*own, strict=False):
        yield torch.cat(several)
