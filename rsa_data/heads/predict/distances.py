"""From relative depth to metres: what known distances did to a prediction, and what is said of it.

The mathematics is in `known_depth` and `correction`.
"""

from collections.abc import Sequence

import numpy as np

from ...common.errors import RsaDataError
from ...common.numbers import reals
from ..metric import to_metric
from . import correction, known_depth
from .choices import Hints
from .known_depth import Fit
from .prediction import Known, Prediction

# A fit that misses a distance by more than this is doubted; a tape measure on a pixel of a
# relative-depth map is seldom off by half of it (correction.POINT_ERROR).
DOUBTFUL = 0.25
# Share of the pixels without a finite depth above which that is said.
_HOLES = 0.01


def measure(
    p: Prediction, y: np.ndarray, hints: Hints, prior: dict[str, float] | None, head: bool
) -> None:
    """Corrects scale and shift by the known distances, or fits them, and adds the depth.

    p : with the head's scale and shift, if there is a head. y : float32 (h, w), relative depth of
    the whole photo. prior : how far the head is off, see `correction.refine`.
    Raises as `known_depth.points`, `ends` and `fit` do, and where known distances contradict the
    relative depth.
    """
    of = None if p.image is None else (y.shape[1], y.shape[0])
    at, metres = known_depth.points(y, hints.known, of)
    pixels: list[tuple[float, float] | None] = [_pixel(text) for text in hints.known]
    if hints.range:
        ends = known_depth.ends(y, hints.range)
        at, metres = np.concatenate([at, ends[0]]), np.concatenate([metres, ends[1]])
        pixels += [None, None]
    used = np.ones(len(at), bool)
    if not head:
        found = _alone(y, at, metres)
        p.scale, p.shift, used = found.scale, found.shift, found.used
        p.warnings += [found.assumption] if found.assumption else []
    else:
        p.words = (p.scale, p.shift)
    if head and len(at):
        p.scale, p.shift, used = correction.correct(p.scale, p.shift, at, metres, prior)
        if not p.scale > 0:
            raise RsaDataError(
                "--known: the distances say that nearer is where the relative depth is farther, "
                "which would make the whole photo flat. Check the pixels, or name the right depth "
                "model"
            )
    depths = to_metric(at.astype(np.float32), p.scale, p.shift)
    p.known = [
        Known(float(z), float(depth), bool(ok), pixel)
        for z, depth, ok, pixel in zip(metres, depths, used, pixels, strict=True)
    ]
    p.notes += told(p.known, p.words)
    p.warnings += doubts(p.known, head)
    p.depth = to_metric(y, p.scale, p.shift)
    blank, beyond = float(np.mean(np.isnan(p.depth))), float(np.mean(p.depth == np.inf))
    if blank > _HOLES:
        p.warnings.append(f"the depth model gives no depth for {blank:.0%} of the photo")
    if beyond > _HOLES:
        p.warnings.append(f"{beyond:.0%} of the photo has no finite depth")


def _pixel(text: str) -> tuple[float, float]:
    u, v, _ = reals(text, 3)
    return u, v


def _alone(y: np.ndarray, at: np.ndarray, metres: np.ndarray) -> Fit:
    found = known_depth.fit(at, metres)
    holes = float(np.mean(to_metric(y, found.scale, found.shift) == np.inf))
    if found.shift < 0 and holes > _HOLES and (at > 0).all():
        why = f"a shift below 0 would leave {holes:.0%} of the pixels without a finite depth"
        found = known_depth.without_shift(found, at, metres, f"{why}: it is held at 0")
    return found


def told(known: Sequence[Known], words: tuple[float, float] | None) -> list[str]:
    """What was known and how far the result is off there, in words.

    words : scale and shift of the head alone, where it was corrected.
    """
    if not known:
        return []
    parts = [f"{k.metres:g} m {k.error:+.1%}{'' if k.used else ' (left out)'}" for k in known]
    if words is None:
        return [f"from known distances alone; residuals: {', '.join(parts)}"]
    return [
        f"from words alone: scale {words[0]:.6g}, shift {words[1]:.6g}",
        f"corrected by known distances; residuals: {', '.join(parts)}",
    ]


def doubts(known: Sequence[Known], head: bool) -> list[str]:
    """Warnings: of distances left out, and where the depth misses those that were used."""
    said = []
    if out := [k for k in known if not k.used]:
        others = "the others and the head" if head else "the others"
        listed = ", ".join(f"{k.name} ({k.depth:.3g} m in the result)" for k in out)
        said.append(f"known distances that contradict {others} were left out: {listed}")
    missed = [k for k in known if k.used and not abs(k.error) <= DOUBTFUL]
    if missed:
        listed = ", ".join(f"{k.name} by {abs(k.error):.0%}" for k in missed)
        others = (
            "the relative depth, with the head or with each other" if head else "the relative depth"
        )
        said.append(
            f"the known distances do not agree with {others}: the result misses {listed}; check "
            "the pixels and the distances of all of them"
        )
    return said
