"""What training minimises: functions from inverse depth or logarithms to one number an image."""

from collections.abc import Callable

import torch

# Metric depth of the head (m) and of the ground truth (m), both (b, k) -> (b,).
Loss = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]


def depth(inverse: torch.Tensor, far: torch.Tensor) -> torch.Tensor:
    """1 / inverse, continued along its tangent where it would lie beyond `far`: always finite.

    inverse : scale * y + shift, 1/m, (b, k), of any sign. far : m, (b, 1), the dataset's maximum
    depth. Without the tangent a point at inverse 0 would have an infinite loss, and with a clamp
    instead it would have no gradient that brings it back.
    """
    near = inverse.clamp_min(1 / far)
    return 1 / near + (near - inverse) * far.square()


def l1(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Mean absolute error."""
    return (predicted - true).abs().mean(1)


def huber(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Huber with delta 1, as in the released code."""
    return torch.nn.functional.huber_loss(predicted, true, reduction="none").mean(1)


def log_l1(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Mean absolute error of the logarithm: about the relative error."""
    return (predicted.log() - true.log()).abs().mean(1)


def silog(predicted: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
    """Scale-invariant error of the logarithm, with 0.85 of the mean taken off (BTS): 10 sqrt(.).

    Eigen et al. 2014 with the weight of Lee et al. 2019, over an image's pixels.
    """
    error = predicted.log() - true.log()
    # The variance is never negative, but its float32 estimate may be; the root wants more than 0.
    return 10 * (error.square().mean(1) - 0.85 * error.mean(1).square()).clamp_min(1e-8).sqrt()


def to_fit(scale: torch.Tensor, shift: torch.Tensor, fit: torch.Tensor) -> torch.Tensor:
    """Error of the logarithms of scale and shift against the image's own least-squares fit, (b,).

    fit : (b, 2). Only what is positive there can be reached by the head and counts: an image whose
    fit has a negative shift teaches its scale alone, one with both negative, or none, nothing.
    """
    error = (torch.stack([scale, shift], 1).log() - fit.clamp_min(1e-12).log()).abs()
    return torch.where(fit > 0, error, 0.0).sum(1)


LOSSES: dict[str, Loss] = {"l1": l1, "huber": huber, "log-l1": log_l1, "silog": silog}
# Those that grow with the unit: an error of 1 m weighs the same in a room and in a street.
METRIC = ("l1", "huber")
