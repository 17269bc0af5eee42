"""Text and image features together: each through layers of its own, then one shared network.

The first `text_dim` inputs are the text's, the others the image's.
"""

from collections.abc import Sequence

import torch
from torch import nn

from .layers import Head, Seen, mlp, positive


class Fusion(Head):
    """Text and image features together."""

    reads = ("text", "image")

    @classmethod
    def sizes(cls, inputs: Sequence[Seen]) -> dict[str, int]:
        return {"text_dim": inputs[0].width}

    def __init__(self, dim: int, text_dim: int):
        super().__init__()
        self.text_dim = text_dim
        self.text_net = mlp(text_dim, 512, 256)
        self.image_net = mlp(dim - text_dim, 512, 256)
        self.scene_feat_net = mlp(512, 512, 256, 256)
        self.shift_net = mlp(256, 128, 64, 1)
        self.scale_net = mlp(256, 128, 64, 1)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Scale (1/m per unit of y) and shift (1/m), float32 (n,), of features x (n, dim)."""
        text, image = x[:, : self.text_dim], x[:, self.text_dim :]  # (n, text), (n, image)
        both = torch.cat([self.text_net(text), self.image_net(image)], 1)  # (n, 512)
        x = self.scene_feat_net(nn.functional.leaky_relu(both))  # (n, 256)
        return positive(self.scale_net(x)), positive(self.shift_net(x))  # (n,), (n,)
