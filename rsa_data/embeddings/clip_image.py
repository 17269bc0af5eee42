"""CLIP RN50's image tower (OpenAI, 2021): the whole network, by the names of its checkpoints.

A ResNet-50 with three changes: a stem of three convolutions, an average pool before each strided
step in place of the stride, and at the end attention of the mean over all places.
Source: openai/CLIP, clip/model.py, ModifiedResNet.
"""

import torch
from torch import nn
from torch.nn import functional as F


class Bottleneck(nn.Module):
    """Three convolutions beside a shortcut; halves the image by pooling when `stride` is 2."""

    def __init__(self, channels: int, width: int, stride: int = 1):
        super().__init__()
        self.stride = stride
        self.conv1, self.bn1 = nn.Conv2d(channels, width, 1, bias=False), nn.BatchNorm2d(width)
        self.conv2 = nn.Conv2d(width, width, 3, padding=1, bias=False)
        self.bn2 = nn.BatchNorm2d(width)
        self.conv3 = nn.Conv2d(width, 4 * width, 1, bias=False)
        self.bn3 = nn.BatchNorm2d(4 * width)
        self.downsample = (
            nn.Sequential(nn.Conv2d(channels, 4 * width, 1, bias=False), nn.BatchNorm2d(4 * width))
            if stride > 1 or channels != 4 * width
            else None
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        y = F.relu(self.bn1(self.conv1(x)))
        y = F.relu(self.bn2(self.conv2(y)))
        if self.stride > 1:
            x, y = F.avg_pool2d(x, self.stride), F.avg_pool2d(y, self.stride)
        y = self.bn3(self.conv3(y))
        shortcut: torch.Tensor = x if self.downsample is None else self.downsample(x)
        y = y + shortcut
        return F.relu(y)


class AttentionPool(nn.Module):
    """The mean over all places asks all places (and itself) by attention."""

    def __init__(self, places: int, width: int, heads: int, dim: int):
        super().__init__()
        self.heads = heads
        self.positional_embedding = nn.Parameter(torch.zeros(places + 1, width))
        self.q_proj, self.k_proj = nn.Linear(width, width), nn.Linear(width, width)
        self.v_proj, self.c_proj = nn.Linear(width, width), nn.Linear(width, dim)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = x.flatten(2).transpose(1, 2)  # (b, places, width)
        x = torch.cat([x.mean(1, keepdim=True), x], 1)  # (b, places + 1, width)
        x = x + self.positional_embedding
        q, k, v = (
            project(rows).unflatten(-1, (self.heads, -1)).transpose(1, 2)
            for project, rows in ((self.q_proj, x[:, :1]), (self.k_proj, x), (self.v_proj, x))
        )  # (b, heads, 1 or places + 1, width / heads)
        x = F.scaled_dot_product_attention(q, k, v)  # (b, heads, 1, width / heads)
        pooled: torch.Tensor = self.c_proj(x.flatten(1))  # (b, dim)
        return pooled


class ImageTower(nn.Module):
    """Images to features that are not normalised; the default sizes are those of CLIP RN50."""

    def __init__(
        self,
        *,
        layers: tuple[int, ...] = (3, 4, 6, 3),
        width: int = 64,
        heads: int = 32,
        size: int = 224,
        dim: int = 1024,
    ):
        super().__init__()
        half = width // 2
        self.conv1 = nn.Conv2d(3, half, 3, stride=2, padding=1, bias=False)
        self.conv2 = nn.Conv2d(half, half, 3, padding=1, bias=False)
        self.conv3 = nn.Conv2d(half, width, 3, padding=1, bias=False)
        self.bn1, self.bn2 = nn.BatchNorm2d(half), nn.BatchNorm2d(half)
        self.bn3 = nn.BatchNorm2d(width)
        stages = []
        channels = width
        for number, depth in enumerate(layers):
            inner = width * 2**number
            blocks = [Bottleneck(channels, inner, 1 if number == 0 else 2)]
            blocks += [Bottleneck(4 * inner, inner) for _ in range(depth - 1)]
            stages.append(nn.Sequential(*blocks))
            channels = 4 * inner
        self.layer1, self.layer2, self.layer3, self.layer4 = stages
        self.attnpool = AttentionPool((size // 32) ** 2, channels, heads, dim)

    def forward(self, pixels: torch.Tensor) -> torch.Tensor:
        """Features of images.

        pixels : float of shape (b, 3, size, size), RGB, normalised by CLIP's mean and deviation.

        Returns float of shape (b, dim).
        """
        x = F.relu(self.bn1(self.conv1(pixels)))
        x = F.relu(self.bn2(self.conv2(x)))
        x = F.avg_pool2d(F.relu(self.bn3(self.conv3(x))), 2)  # (b, width, size / 4, size / 4)
        for layer in (self.layer1, self.layer2, self.layer3, self.layer4):
            x = layer(x)
        features: torch.Tensor = self.attnpool(x)  # (b, dim)
        return features
