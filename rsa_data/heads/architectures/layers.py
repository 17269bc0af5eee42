"""What heads are built of: their base class, and layers that several use."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, ClassVar, Protocol

import torch
from torch import nn

from ...common import own_code


class Seen(Protocol):
    """What a head may ask of one of its inputs before it is built; see `heads.inputs`.

    width : numbers in an image's row, for a set those of one object. objects : objects that a row
    of fixed length has room for, 1 where it is no set.
    """

    @property
    def width(self) -> int: ...

    @property
    def objects(self) -> int: ...


class Head(nn.Module):
    """A network from a row of features for each image to its scale and shift.

    Built as `Head(dim, **sizes)`, dim being the numbers in a row; called with float32 (n, dim).

    reads : kinds of input (see registry.INPUTS) whose rows stand side by side in that order. Empty:
        one vector of any kind, or a text's and an image's, as --style and --encoder say.
    standardize : whether rows may be centred and divided by their spread before they come in.
    """

    reads: ClassVar[tuple[str, ...]] = ()
    standardize: ClassVar[bool] = True

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        # Code of the user's that runs already may name more of it: inputs as module:attribute.
        own_code.allow(cls.reads)

    @classmethod
    def sizes(cls, inputs: Sequence[Seen]) -> dict[str, int]:
        """Further arguments of the constructor, from the inputs in the order of `reads`."""
        return {}

    def fits(self, columns: int, dim: int) -> bool:
        """Whether rows may have so many numbers; those of a head of sets have any length."""
        return columns == dim

    def centred(self, x: torch.Tensor, mean: torch.Tensor, factor: torch.Tensor) -> torch.Tensor:
        """Rows x (n, dim) standardised by mean and factor, (dim,), for `forward`."""
        return (x - mean) * factor

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Scale (1/m per unit of y) and shift (1/m), float32 (n,), positive, of rows x (n, dim)."""
        raise NotImplementedError


def mlp(*sizes: int) -> nn.Sequential:
    """Linear layers of these sizes with LeakyReLU between them and none after the last."""
    layers: list[nn.Module] = []
    for size_in, size_out in pairwise(sizes):
        layers += [nn.Linear(size_in, size_out), nn.LeakyReLU()]
    return nn.Sequential(*layers[:-1])


def positive(x: torch.Tensor) -> torch.Tensor:
    """exp of a (n, 1) output, in float32 whatever precision the layers ran in: (n,)."""
    return x.float().squeeze(-1).exp()
