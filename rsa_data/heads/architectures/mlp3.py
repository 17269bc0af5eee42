"""The earlier head of the released checkpoints: three layers instead of five.

804,354 parameters at 1024 inputs; names as in the released code, so that its checkpoints fit. That
code once had a sigmoid where the paper has exp for the scale; at the released scales, around 0.02
to 0.06, they differ by 2 to 6%. This is exp, as in the paper.
"""

import torch

from .layers import Head, mlp, positive


class Mlp3(Head):
    """The head of the released checkpoints: three shared layers, three each for scale and shift."""

    def __init__(self, dim: int):
        super().__init__()
        self.scene_feat_net = mlp(dim, 512, 256, 256)
        self.shift_net = mlp(256, 128, 64, 1)
        self.scale_net = mlp(256, 128, 64, 1)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Scale (1/m per unit of y) and shift (1/m), float32 (n,), of features x (n, dim)."""
        x = self.scene_feat_net(x)  # (n, 256)
        return positive(self.scale_net(x)), positive(self.shift_net(x))  # (n,), (n,)
