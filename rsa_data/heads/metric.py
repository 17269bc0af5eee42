"""From relative to metric depth."""

from typing import Any

import numpy as np

from ..common.errors import UsageError


def to_metric(relative: Any, scale: Any, shift: Any) -> Any:
    """Metric depth = 1 / (scale * y + shift), in m.

    relative : y, the depth model's raw output (inverse depth up to scale and shift, larger is
        nearer), float numpy array or torch tensor of any shape, such as (height, width) or
        (n, height, width).
    scale, shift : 1/m per unit of y, and 1/m: numbers, or of shape (n,) for n maps, in which case
        `relative` has n as its first axis.

    Returns the depth in m, of the shape and kind of `relative`, float32. Where scale * y + shift
    is not positive (y goes negative after bicubic resizing, for instance) the depth is inf: such a
    point is beyond everything; evaluation then clips it to the protocol's maximum depth. nan stays
    nan.
    """
    if not hasattr(relative, "detach"):
        y = _array("relative", relative)
        scale, shift = _array("scale", scale), _array("shift", shift)
        for number in (scale, shift):
            if number.ndim > 1 or (number.ndim == 1 and number.shape != y.shape[:1]):
                raise UsageError(
                    "to_metric: expected scale and shift as numbers, or one for each map of "
                    f"relative {y.shape}; found the shape {number.shape}"
                )
        inverse = np.asarray(_spread(scale, y) * y)
        # In place, since a map of 100 megapixels takes 400 MB.
        inverse += _spread(shift, y)
        beyond = inverse <= 0
        with np.errstate(divide="ignore"):
            np.divide(np.float32(1), inverse, out=inverse)
        inverse[beyond] = np.inf
        return inverse
    import torch

    y = relative.float()
    scale = torch.as_tensor(scale, dtype=torch.float32, device=y.device)
    shift = torch.as_tensor(shift, dtype=torch.float32, device=y.device)
    inverse = _spread(scale, y) * y + _spread(shift, y)
    return torch.where(inverse <= 0, torch.inf, 1 / inverse)


def _array(name: str, given: Any) -> np.ndarray:
    try:
        return np.asarray(given.detach().cpu() if hasattr(given, "detach") else given, np.float32)
    except (TypeError, ValueError) as error:
        raise UsageError(
            f"to_metric: {name}: expected numbers; found {type(given).__name__}"
        ) from error


def _spread(number: Any, y: Any) -> Any:
    """(n,) becomes (n, 1, 1) beside y (n, height, width); a number stays a number."""
    return number.reshape(number.shape + (1,) * (y.ndim - 1)) if number.ndim == 1 else number
