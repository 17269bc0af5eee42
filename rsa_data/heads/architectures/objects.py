"""Heads that read what stands in the image instead of a sentence about it, or beside it.

A small network on each object, the mean over the objects and the mean by area, a network on both:
the order of the objects makes no difference, and any number of them does, none included (Zaheer et
al. 2017, Deep Sets). In training objects are dropped, and all places or all shares of an image are
hidden, so that a list of names is enough, or what a poor detector leaves.
"""

from collections.abc import Sequence
from typing import ClassVar

import torch
from torch import nn

from .layers import Head, Seen, mlp, positive
from .sets import ObjectSet


class Objects(Head):
    """Class names, shares and places of the objects, in no order: no sentence, no token limit."""

    reads: ClassVar[tuple[str, ...]] = ("objects",)
    places: ClassVar[bool] = True
    shares: ClassVar[bool] = True

    def __init__(self, dim: int, object_dim: int):
        super().__init__()
        self.object_dim, self.before = object_dim, dim - object_dim
        self.objects = ObjectSet(object_dim, self.places, self.shares)
        width = 2 * self.objects.width
        if self.before:
            self.vector_net = mlp(self.before, 512, 256)
            width += 256
        self.scene_net = mlp(width, 256, 256)
        self.shift_net = mlp(256, 64, 1)
        self.scale_net = mlp(256, 64, 1)

    @classmethod
    def sizes(cls, inputs: Sequence[Seen]) -> dict[str, int]:
        return {"object_dim": inputs[-1].width}

    def fits(self, columns: int, dim: int) -> bool:
        return columns >= self.before and (columns - self.before) % self.object_dim == 0

    def centred(self, x: torch.Tensor, mean: torch.Tensor, factor: torch.Tensor) -> torch.Tensor:
        return self.objects.centred(x, mean, factor)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Scale (1/m per unit of y) and shift (1/m), float32 (n,).

        x : (n, before + m * object_dim), the features of a text or image, then the objects.
        """
        seen = self.objects(x[:, self.before :])  # (n, 2 * width)
        if self.before:
            vector = self.vector_net(x[:, : self.before])  # (n, 256)
            seen = torch.cat([nn.functional.leaky_relu(vector), seen], 1)
        scene = nn.functional.leaky_relu(self.scene_net(seen))  # (n, 256)
        return positive(self.scale_net(scene)), positive(self.shift_net(scene))  # (n,), (n,)


class ObjectsWithoutPlaces(Objects):
    """The head `objects` that does not see where the objects are."""

    places = False


class ObjectNames(Objects):
    """The head `objects` that sees only the names of the objects, as often as they occur."""

    places, shares = False, False


class TextAndObjects(Objects):
    """A caption's feature beside the objects."""

    reads = ("text", "objects")


class ImageAndObjects(Objects):
    """An image's feature beside the objects."""

    reads = ("image", "objects")


class TextImageAndObjects(Objects):
    """The features of a caption and of the image beside the objects."""

    reads = ("text", "image", "objects")
