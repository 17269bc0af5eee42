"""An image encoder without weights: coarse colours and directions of edges, by hand.

It needs no download, so that a comparison of text and image runs anywhere; a trained encoder such
as CLIP's sees far more, and what this one loses by says nothing about those.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .encoder import Encoder, ImageModel

if TYPE_CHECKING:
    import torch

_HEIGHT, _WIDTH = 96, 128  # px that every image is squashed to
_BINS = 8  # directions of edges, over half a turn


def prepare(image: np.ndarray) -> np.ndarray:
    """uint8 (h, w, 3), RGB -> float32 (3, 96, 128), 0 to 1."""
    import cv2

    small = cv2.resize(image, (_WIDTH, _HEIGHT), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(small.transpose(2, 0, 1), np.float32) / np.float32(255)


def _network() -> "torch.nn.Module":
    import torch
    from torch.nn import functional as F

    class Thumbnail(torch.nn.Module):
        """6 x 8 mean colours, then the edge strength of 3 x 4 cells in 8 directions."""

        def forward(self, pixels: torch.Tensor) -> torch.Tensor:
            colours = F.avg_pool2d(pixels, 16)  # (b, 3, 6, 8)
            grey = pixels.mean(1)  # (b, 96, 128)
            dx = grey[:, 1:-1, 2:] - grey[:, 1:-1, :-2]
            dy = grey[:, 2:, 1:-1] - grey[:, :-2, 1:-1]
            strength = (dx.square() + dy.square()).sqrt()  # (b, 94, 126)
            turn = torch.atan2(dy, dx).remainder(torch.pi) * (_BINS / torch.pi)
            direction = turn.long().clamp_max(_BINS - 1)
            edges = F.one_hot(direction, _BINS).movedim(-1, 1) * strength[:, None]
            cells = F.adaptive_avg_pool2d(edges, (3, 4)).sqrt()  # (b, 8, 3, 4)
            return torch.cat([colours.flatten(1), cells.flatten(1)], 1)  # (b, 240)

    return Thumbnail().eval()


def _files(argument: str | None, weights: Path | None) -> dict[str, Path]:
    return {}


def _load(files: dict[str, Path]) -> ImageModel:
    return ImageModel(module=_network(), prepare=prepare, dim=3 * 6 * 8 + _BINS * 3 * 4)


THUMBNAIL: Encoder[ImageModel] = Encoder(
    doc="Coarse colours and edges, 240 numbers without weights or download: a baseline only.",
    files=_files,
    load=_load,
)
