"""The paper's detector-feature row: a 3-layer MLP on each object's feature, mean-pooled.

Its input is what `embed-proposals` writes: the features of an image's objects side by side, each
with a 1 behind it, zeros where there is no object. An image without objects gives the pool's zero.
"""

from collections.abc import Sequence

import torch
from torch import nn

from .layers import Head, Seen, mlp, positive


class Proposals(Head):
    """Features of a detector's proposals, each through an MLP, then their mean."""

    reads = ("proposals",)
    standardize = False  # it would move the zeros that mean nothing is there

    @classmethod
    def sizes(cls, inputs: Sequence[Seen]) -> dict[str, int]:
        return {"feature_dim": inputs[0].width // inputs[0].objects - 1}

    def __init__(self, dim: int, feature_dim: int):
        super().__init__()
        self.width = feature_dim + 1
        # Detectors' features come in any size.
        self.norm = nn.LayerNorm(feature_dim)
        self.object_net = mlp(feature_dim, 512, 256, 256)
        self.shift_net = mlp(256, 128, 64, 1)
        self.scale_net = mlp(256, 128, 64, 1)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Scale (1/m per unit of y) and shift (1/m), float32 (n,), of rows x (n, dim)."""
        x = x.reshape(len(x), -1, self.width)  # (n, m, d + 1)
        there = x[..., -1:]  # (n, m, 1)
        each = self.object_net(self.norm(x[..., :-1])) * there  # (n, m, 256)
        pooled = each.sum(1) / there.sum(1).clamp_min(1)  # (n, 256)
        return positive(self.scale_net(pooled)), positive(self.shift_net(pooled))  # (n,), (n,)
