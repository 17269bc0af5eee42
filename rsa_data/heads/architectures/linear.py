"""The smallest head: the logarithms of scale and shift are linear in the features."""

import torch

from .layers import Head, mlp, positive


class Linear(Head):
    """Logarithms of scale and shift linear in the features: the least that can be learned."""

    def __init__(self, dim: int):
        super().__init__()
        self.shift_net = mlp(dim, 1)
        self.scale_net = mlp(dim, 1)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Scale (1/m per unit of y) and shift (1/m), float32 (n,), of features x (n, dim)."""
        return positive(self.scale_net(x)), positive(self.shift_net(x))  # (n,), (n,)
