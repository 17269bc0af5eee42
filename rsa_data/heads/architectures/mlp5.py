"""The paper's head: a shared 5-layer MLP, then a 5-layer MLP each for scale and for shift.

1,494,274 parameters at 1024 inputs. The names of the three networks are those of the released
code (Adonis-galaxy/RSA, lanscale.py), so that its checkpoints fit.
"""

import torch

from .layers import Head, mlp, positive


class Mlp5(Head):
    """The paper's final head: five shared layers, five each for scale and shift."""

    def __init__(self, dim: int):
        super().__init__()
        # There is no activation between the shared network and the two behind it: so it was
        # trained and released.
        self.scene_feat_net = mlp(dim, 512, 512, 512, 256, 256)
        self.shift_net = mlp(256, 256, 128, 128, 64, 1)
        self.scale_net = mlp(256, 256, 128, 128, 64, 1)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Scale (1/m per unit of y) and shift (1/m), float32 (n,), of features x (n, dim)."""
        x = self.scene_feat_net(x)  # (n, 256)
        return positive(self.scale_net(x)), positive(self.shift_net(x))  # (n,), (n,)
