"""The part of a head that reads a set of objects."""

import torch
from torch import nn

from .layers import mlp

# Behind the feature of the name: see heads.inputs.objects.NUMBERS.
_NUMBERS = 8
_SHARE, _PLACE, _THERE = slice(0, 3), slice(3, 6), 7
# Brings log share (0 to -9), share, place (-0.5 to 0.5) and the rest to about the same spread.
_SPREAD = (0.5, 3.0, 1.0, 3.0, 3.0, 1.0, 1.0)
# A name's feature has hundreds of numbers; so many are enough to tell things apart, and the few
# others beside them are heard.
_NAME = 32
# In training: the most of an image's objects that are dropped, and how often all shares or all
# places of an image are hidden.
_DROPPED, _HIDDEN = 0.2, 0.1


class ObjectSet(nn.Module):
    """Objects of each image -> mean and mean by area of what a small network makes of each.

    object_dim : numbers an object: the feature of its name, then 8 numbers.
    places, shares : whether these are read at all.
    """

    width = 256

    def __init__(self, object_dim: int, places: bool = True, shares: bool = True):
        super().__init__()
        if object_dim <= _NUMBERS:
            raise ValueError(f"object_dim: expected more than {_NUMBERS}; found {object_dim}")
        self.object_dim, self.places, self.shares = object_dim, places, shares
        self.name_net = nn.Linear(object_dim - _NUMBERS, _NAME)
        self.object_net = mlp(_NAME + _THERE, self.width, self.width)

    def centred(self, x: torch.Tensor, mean: torch.Tensor, factor: torch.Tensor) -> torch.Tensor:
        """Rows x (n, before + m * object_dim) standardised; what stands for no object stays 0.

        mean, factor : (before + object_dim,).
        """
        before = len(mean) - self.object_dim
        vector = (x[:, :before] - mean[:before]) * factor[:before]  # (n, before)
        objects = x[:, before:].reshape(len(x), -1, self.object_dim)  # (n, m, d)
        objects = (objects - mean[before:]) * factor[before:] * objects[..., -1:]
        return torch.cat([vector, objects.flatten(1)], 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """x (n, m * object_dim) -> (n, 2 * width)."""
        features, numbers = self._read(x.reshape(len(x), -1, self.object_dim))
        there = (numbers[..., _THERE:] > 0.5).to(x.dtype)  # (n, m, 1)
        spread = torch.tensor(_SPREAD, device=x.device)
        seen = torch.cat([self.name_net(features), numbers[..., :_THERE] * spread], 2)
        each = nn.functional.leaky_relu(self.object_net(seen)) * there  # (n, m, width)
        mean = each.sum(1) / there.sum(1).clamp_min(1)  # (n, width)
        # Where shares are not known all objects weigh the same.
        known = numbers[..., 2:3] > 0.5  # (n, m, 1)
        weight = torch.where(known, numbers[..., 1:2].clamp_min(0), 1.0) * there  # (n, m, 1)
        by_area = (each * weight).sum(1) / weight.sum(1).clamp_min(1e-6)  # (n, width)
        return torch.cat([mean, by_area], 1)

    def _read(self, objects: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Features of the names (n, m, d - 8) and numbers (n, m, 8), as far as they are read."""
        n, m, _ = objects.shape
        features, numbers = objects[..., :-_NUMBERS], objects[..., -_NUMBERS:].clone()
        if not self.shares:
            numbers[..., _SHARE] = 0
        if not self.places:
            numbers[..., _PLACE] = 0
        if self.training:
            numbers[..., _SHARE] *= torch.rand(n, 1, 1) >= _HIDDEN
            numbers[..., _PLACE] *= torch.rand(n, 1, 1) >= _HIDDEN
            # A mirrored image is as good an image.
            numbers[..., 3:4] *= torch.where(torch.rand(n, 1, 1) < 0.5, -1.0, 1.0)
            kept = torch.rand(n, m, 1) >= _DROPPED * torch.rand(n, 1, 1)
            features, numbers = features * kept, numbers * kept
        return features, numbers
