"""What is known besides the words: points, a range, the frames around; metres without a head."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...common.errors import RsaDataError, UsageError
from ...common.numbers import reals

# Distances that somebody can mean, m: what lies outside is a slip, or a unit other than metres.
NEAREST, FARTHEST = 0.001, 100_000.0
_DISTANCES = "0.001 m (1 mm) to 100,000 m (100 km)"


@dataclass(frozen=True)
class Fit:
    """Scale and shift from known points alone.

    residuals : relative error of the fitted depth at each point, + where it is too far.
    used : bool, false for points that contradict the others and were left out.
    assumption : what had to be assumed, or nothing.
    """

    scale: float
    shift: float
    residuals: np.ndarray
    used: np.ndarray
    assumption: str = ""


# A point that misses the fit of the others by more than this is left out, if they agree.
WRONG = 0.25


def fit(y: np.ndarray, metres: np.ndarray) -> Fit:
    """Scale and shift from points of known depth, without a head.

    Minimises sum_k ((a y_k + b) z_k - 1)^2 over a > 0 and b: least squares in inverse depth,
    relative to each. Points that contradict the others are left out first, see `agreeing`. One
    point gives the scale alone, with the shift assumed to be 0.

    y, metres : float (k,), relative depth at the points and their depth, m, above 0.
    Raises RsaDataError where the points contradict the relative depth, which grows towards the
    viewer, or where they are all equally near.
    """
    check_points(y, metres)
    if len(y) == 1:
        if (near := y.item()) <= 0:
            raise RsaDataError(
                f"--known: the relative depth at the point is {near:.4g}; one point alone needs "
                "one above 0. Give a second point at another distance"
            )
        scale = 1 / (near * metres.item())
        told = "one point gives the scale alone: the shift is assumed to be 0. Give a second one"
        return Fit(scale, 0.0, np.zeros(1), np.ones(1, bool), told)
    used = agreeing(y, metres)
    scale, shift = _least_squares(y[used], metres[used])
    inverse = scale * y + shift
    residuals = np.where(inverse > 0, 1 / np.where(inverse > 0, inverse, 1) / metres - 1, np.inf)
    if not scale > 0:
        listed = "; ".join(f"y {a:.4g} at {z:g} m" for a, z in zip(y, metres, strict=True))
        raise RsaDataError(
            "--known: expected the relative depth y to be larger at nearer points; found "
            f"{listed}. Check the pixels, or name the right depth model"
        )
    return Fit(float(scale), float(shift), residuals, used)


def without_shift(found: Fit, y: np.ndarray, metres: np.ndarray, why: str) -> Fit:
    """The same points with the shift held at 0; why : said as the assumption.

    The scale is the median of those that the points ask for (of their logarithms, so that two
    points count alike), which one wrong point of three does not move. y : above 0.
    """
    scale = float(np.exp(np.median(-np.log((y * metres)[found.used]))))
    residuals = 1 / (scale * y) / metres - 1
    used = found.used & (np.abs(scale * y * metres - 1) <= WRONG)
    most = 2 * used.sum() > found.used.sum()
    return Fit(scale, 0.0, residuals, used if most else found.used, why)


def _least_squares(y: np.ndarray, metres: np.ndarray) -> tuple[float, float]:
    if np.ptp(y) <= 1e-6 * np.abs(y).max():
        raise RsaDataError(
            "--known: the relative depth is the same at all points, so they give no scale; choose "
            "points at other distances"
        )
    matrix = np.stack([y, np.ones_like(y)], 1) * metres[:, None]
    scale, shift = np.linalg.lstsq(matrix, np.ones(len(y)), rcond=None)[0]
    return float(scale), float(shift)


def agreeing(y: np.ndarray, metres: np.ndarray) -> np.ndarray:
    """Which points agree with the pair whose line suits most points best; all, if none does.

    bool (k,). Those that miss that line by more than 25% do not agree (least median of squares,
    Rousseeuw 1984). Of fewer than four points nobody can tell which one is wrong.
    """
    everyone = np.ones(len(y), bool)
    if len(y) < 4:
        return everyone
    few = np.linspace(0, len(y) - 1, min(len(y), 100)).astype(int)
    i, j = (few[k] for k in np.triu_indices(len(few), 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = (1 / metres[i] - 1 / metres[j]) / (y[i] - y[j])
        shift = 1 / metres[i] - scale * y[i]
        error = np.abs((scale[:, None] * y + shift[:, None]) * metres - 1)  # (pairs, k)
    error[~((scale > 0) & np.isfinite(shift))] = np.inf
    # The median of what is left when two points fit by construction: three of five must agree.
    middle = np.sort(error, 1)[:, (len(y) + 1) // 2]
    best = int(np.argmin(middle))
    agree = error[best] <= max(WRONG, 3 * middle[best])
    return agree if np.isfinite(middle[best]) and agree.sum() >= 2 else everyone


def check_points(y: np.ndarray, metres: np.ndarray) -> None:
    """Raises UsageError unless all depths are above 0 and y is defined at all points."""
    if not (np.isfinite(y).all() and (metres > 0).all() and np.isfinite(metres).all()):
        raise UsageError(
            f"known points: expected depths above 0 m where the relative depth is defined; found "
            f"depths {metres.tolist()} at relative depths {y.tolist()}"
        )


def points(
    relative: np.ndarray, known: Sequence[str], size: tuple[int, int] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """y and depth (m) of points written as `u,v,metres`: column, row from the top left in px.

    size : width and height in px of the picture that the points are of; by default the map's.
    """
    y, metres = [], []
    height, width = relative.shape
    across, down = size or (width, height)
    for text in known:
        try:
            u, v, depth = reals(text, 3)
        except ValueError as error:
            raise UsageError(f"--known: expected u,v,metres; found {text!r}") from error
        if not (0 <= u < across and 0 <= v < down):
            of = "the photo" if size else "the relative depth"
            raise UsageError(f"--known {text}: expected a pixel of {of}, {across} x {down}")
        if not NEAREST <= depth <= FARTHEST:
            raise UsageError(f"--known {text}: expected a distance of {_DISTANCES}")
        value = float(relative[int(v * height / down), int(u * width / across)])
        if not np.isfinite(value):
            raise UsageError(
                f"--known {text}: the depth model gives nothing there; "
                f"{_nearest(relative, u * width / across, v * height / down, across / width)}"
            )
        y.append(value)
        metres.append(depth)
    return np.array(y), np.array(metres)


def _nearest(relative: np.ndarray, u: float, v: float, times: float) -> str:
    """Where the nearest pixel with relative depth is, in words; times : px of the photo for one."""
    rows, columns = np.nonzero(np.isfinite(relative))
    if not len(rows):
        return "it gives nothing anywhere"
    k = int(np.argmin((columns - u) ** 2 + (rows - v) ** 2))
    low, high = (columns.min(), rows.min()), (columns.max(), rows.max())
    at = [round(n * times) for n in (columns[k], rows[k], *low, *high)]
    return (
        f"choose another pixel: the nearest with a depth is {at[0]},{at[1]}; all lie in columns "
        f"{at[2]} to {at[4]} and rows {at[3]} to {at[5]}"
    )


def ends(relative: np.ndarray, near_far: str) -> tuple[np.ndarray, np.ndarray]:
    """The nearest and farthest point as known ones, from `near,far` in m.

    The 1st and 99th percentile stand for them: single pixels at the ends are often wrong.
    """
    try:
        near, far = reals(near_far, 2)
    except ValueError as error:
        raise UsageError(f"--range: expected near,far in metres; found {near_far!r}") from error
    if not NEAREST <= near < far <= FARTHEST:
        raise UsageError(f"--range: expected near below far, both {_DISTANCES}; found {near_far}")
    values = relative[np.isfinite(relative)]
    if not len(values):
        raise UsageError("--range: the relative depth is defined nowhere")
    return np.percentile(values, [99, 1]), np.array([near, far])


def smooth(values: np.ndarray, frames: int) -> np.ndarray:
    """Geometric mean over a window of `frames` frames around each, fewer at the ends.

    values : float (n,), above 0, one a frame in order of time. A head's errors are factors, so it
    is the logarithms that are averaged.
    """
    half = frames // 2
    logs = np.concatenate([[0.0], np.cumsum(np.log(values, dtype=np.float64))])
    index = np.arange(len(values))
    first, last = np.maximum(index - half, 0), np.minimum(index + half + 1, len(values))
    mean: np.ndarray = np.exp((logs[last] - logs[first]) / (last - first)).astype(np.float32)
    return mean
