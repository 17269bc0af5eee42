"""What several heads are built of."""

from itertools import pairwise

import torch
from torch import nn


def mlp(*sizes: int) -> nn.Sequential:
    """Linear layers of these sizes with LeakyReLU between them and none after the last."""
    layers: list[nn.Module] = []
    for size_in, size_out in pairwise(sizes):
        layers += [nn.Linear(size_in, size_out), nn.LeakyReLU()]
    return nn.Sequential(*layers[:-1])


def positive(x: torch.Tensor) -> torch.Tensor:
    """exp of a (n, 1) output, in float32 whatever precision the layers ran in: (n,)."""
    return x.float().squeeze(-1).exp()
