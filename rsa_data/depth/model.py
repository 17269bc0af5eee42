"""Relative depth from models and files, and where it meets the ground truth."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Relative:
    """The relative depth of one image, as its source gives it.

    y : float32 of shape (height, width), raw inverse relative depth, larger is nearer, in the
        source's own unit and geometry; NaN where the source gives none.
    box : x0 y0 x1 y1, the part of the image that `y` covers, as fractions of the image's width
        and height: all of it, or the crop that the model saw.
    image : width and height of the image as displayed, px; None where it is not at hand.
    orientation : EXIF's, 1 to 8, by which the image was turned before a model saw it.
    """

    y: np.ndarray
    box: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)
    image: tuple[int, int] | None = None
    orientation: int = 1


# Path of an image relative to the dataset's root -> its relative depth; raises RowError.
Source = Callable[[str], Relative]
