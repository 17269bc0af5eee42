"""The transformer of the paper's rebuttal: 256 hidden, 4 heads, then two 3-layer MLPs.

The rebuttal gives these sizes and no more. One pooled feature is a sequence of one token, in which
attention has nothing to attend to; here a token each for scale and for shift reads the feature's.
"""

import torch
from torch import nn

from .layers import Head, mlp, positive


class Transformer(Head):
    """The rebuttal's transformer: 256 hidden, 4 heads, a 3-layer MLP each for scale and shift."""

    def __init__(self, dim: int, width: int = 256, heads: int = 4, layers: int = 1):
        super().__init__()
        self.project = nn.Linear(dim, width)
        self.queries = nn.Parameter(torch.randn(2, width) * 0.02)
        # No dropout: training must give the same weights whatever else draws random numbers.
        block = nn.TransformerEncoderLayer(width, heads, 4 * width, 0.0, batch_first=True)
        self.blocks = nn.TransformerEncoder(block, layers, enable_nested_tensor=False)
        self.shift_net = mlp(width, 128, 64, 1)
        self.scale_net = mlp(width, 128, 64, 1)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Scale (1/m per unit of y) and shift (1/m), float32 (n,), of features x (n, dim)."""
        queries = self.queries.expand(len(x), -1, -1)  # (n, 2, width)
        tokens = torch.cat([queries, self.project(x)[:, None]], 1)  # (n, 3, width)
        scale, shift, _ = self.blocks(tokens).unbind(1)  # 3 x (n, width)
        return positive(self.scale_net(scale)), positive(self.shift_net(shift))  # (n,), (n,)
