"""What training minimises at the sampled pixels; a line in the registry names each loss."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch


@dataclass(frozen=True)
class Loss:
    """A loss of depth.

    of : metric depth of the head (m) and of the ground truth (m), both (b, k) -> (b,).
    in_metres : whether it grows with the unit, so that an error of 1 m weighs the same in a room
        and in a street.
    """

    of: Callable[[torch.Tensor, torch.Tensor], torch.Tensor]
    in_metres: bool = False

    @property
    def __doc__(self) -> str | None:  # type: ignore[override]
        return self.of.__doc__


def depth(inverse: torch.Tensor, far: torch.Tensor) -> torch.Tensor:
    """1 / inverse, continued along its tangent where it would lie beyond `far`: always finite.

    inverse : scale * y + shift, 1/m, (b, k), of any sign. far : m, (b, 1), the dataset's maximum
    depth. Without the tangent a point at inverse 0 would have an infinite loss, and with a clamp
    instead it would have no gradient that brings it back.
    """
    near = inverse.clamp_min(1 / far)
    return 1 / near + (near - inverse) * far.square()


def raw(inverse: torch.Tensor) -> torch.Tensor:
    """1 / inverse as the released code has it, whatever becomes of it near 0: (b, k), m."""
    return 1 / (inverse + 1e-8)


def _l1(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Mean absolute error, m."""
    return (predicted - true).abs().mean(1)


def _huber(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Huber with delta 1 m, as in the released code."""
    return torch.nn.functional.huber_loss(predicted, true, reduction="none").mean(1)


def _log_l1(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Mean absolute error of the logarithm: about the relative error."""
    return (predicted.log() - true.log()).abs().mean(1)


def _silog(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Scale-invariant error of the logarithm, with 0.85 of the mean taken off (BTS): 10 sqrt(.).

    Eigen et al. 2014 with the weight of Lee et al. 2019, over an image's pixels.
    """
    error = predicted.log() - true.log()
    # The variance is never negative, but its float32 estimate may be; the root wants more than 0.
    return 10 * (error.square().mean(1) - 0.85 * error.mean(1).square()).clamp_min(1e-8).sqrt()


L1 = Loss(_l1, in_metres=True)
HUBER = Loss(_huber, in_metres=True)
LOG_L1 = Loss(_log_l1)
SILOG = Loss(_silog)


def over_images(loss: torch.Tensor, dataset: torch.Tensor, log: np.ndarray) -> torch.Tensor:
    """The loss of a mixed batch: mean over its images, or over those of each dataset where one of
    them enters as its logarithm.

    loss, dataset : of each image, (b,). log : bool for each dataset.
    """
    return loss.mean() if not log.any() else _added(loss, dataset, log, torch.mean)


def over_each(loss: torch.Tensor, dataset: torch.Tensor, log: np.ndarray) -> torch.Tensor:
    """The loss of a batch of every dataset: sums over their images, added, as in the release.

    The release divides a loss by its own detached value, which has the gradient of its logarithm.
    """
    return _added(loss, dataset, log, torch.sum)


def _added(
    loss: torch.Tensor,
    dataset: torch.Tensor,
    log: np.ndarray,
    reduce: Callable[[torch.Tensor], torch.Tensor],
) -> torch.Tensor:
    total = torch.zeros(())
    for d in torch.unique(dataset).tolist():
        own = reduce(loss[dataset == d])
        total = total + (own.log() if log[d] else own)
    return total


def to_fit(scale: torch.Tensor, shift: torch.Tensor, fit: torch.Tensor) -> torch.Tensor:
    """Error of the logarithms of scale and shift against the image's own least-squares fit, (b,).

    fit : (b, 2). Only what is positive there can be reached by the head and counts: an image whose
    fit has a negative shift teaches its scale alone, one with both negative, or none, nothing.
    """
    error = (torch.stack([scale, shift], 1).log() - fit.clamp_min(1e-12).log()).abs()
    return torch.where(fit > 0, error, 0.0).sum(1)
