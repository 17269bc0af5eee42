"""The objects of a photo, with their share of it and their distance."""

from dataclasses import dataclass

import numpy as np

from ...common.class_names import clean
from ...common.errors import RsaDataError
from ...segments import masks
from ...segments.segments import Segments
from ..inputs.scene import Thing


@dataclass(frozen=True)
class Seen:
    """An object of a photo.

    area : share of the image, 0 to 1. distance : m, None where it is not known.
    over : what the distance is the median over. center : x, y in px of the photo, or None.
    """

    label: str
    area: float
    distance: float | None
    over: str = ""
    center: tuple[float, float] | None = None

    @property
    def line(self) -> str:
        """What a person reads of it."""
        away = "distance unknown" if self.distance is None else f"{self.distance:.2f} m"
        return f"{self.label}, {self.area:.1%} of the image, {away}" + (
            f" (median over {self.over})" if self.over else ""
        )


def seen(found: Segments, depth: np.ndarray | None) -> list[Seen]:
    """The objects of a photo, largest first.

    found : in px of the photo. depth : float (h, w), m, on the whole photo, of any size; inf and
    nan do not count. The distance is the median over the mask, else over the central half of the
    box (half of its width and of its height), where other things are seldom seen.
    """
    regions = _masks(found)
    objects = []
    for k in np.argsort(-found.area, kind="stable"):
        region, over = None, ""
        if regions is not None:
            region, over = regions[k], "its mask"
        elif found.box is not None:
            region, over = found.box[k], "the central half of its box"
        distance = None if depth is None or region is None else _median(found, region, depth)
        center = None if found.center is None else found.center[k]
        objects.append(
            Seen(
                found.label[k],
                float(found.area[k]),
                distance,
                over if distance is not None else "",
                None if center is None else (float(center[0]), float(center[1])),
            )
        )
    return objects


def things(found: Segments) -> tuple[Thing, ...]:
    """The objects of a photo as a head reads them, in the order of the segments."""
    names = [clean(label) for label in found.label]
    centers: list[tuple[float, float] | None] = [None] * len(names)
    if names and found.center is not None and found.width and found.height:
        places = found.center / np.array([found.width, found.height])
        centers = [(float(x), float(y)) for x, y in places]
    return tuple(
        Thing(name, float(area), center, bool(is_thing))
        for name, area, center, is_thing in zip(
            names, found.area, centers, found.is_thing, strict=True
        )
    )


def _masks(found: Segments) -> list[np.ndarray] | None:
    if found.mask is None or found.width is None or found.height is None:
        return None
    try:
        return masks.decode(found.mask, found.height, found.width)
    except RsaDataError:  # without pycocotools the boxes must do
        return None


def _median(found: Segments, region: np.ndarray, depth: np.ndarray) -> float | None:
    height, width = depth.shape
    if region.ndim == 1:
        if not found.width or not found.height:
            return None
        x = np.array([0.75 * region[0] + 0.25 * region[2], 0.25 * region[0] + 0.75 * region[2]])
        y = np.array([0.75 * region[1] + 0.25 * region[3], 0.25 * region[1] + 0.75 * region[3]])
        left, right = np.clip(np.round(x * width / found.width), 0, width).astype(int)
        top, bottom = np.clip(np.round(y * height / found.height), 0, height).astype(int)
        values = depth[
            min(top, height - 1) : max(bottom, top + 1), min(left, width - 1) : max(right, left + 1)
        ]
    else:
        rows = np.arange(height) * region.shape[0] // height
        columns = np.arange(width) * region.shape[1] // width
        values = depth[region[np.ix_(rows, columns)]]
    good = values[np.isfinite(values) & (values > 0)]
    return float(np.median(good)) if len(good) else None
