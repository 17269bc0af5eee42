"""Camera intrinsics: what samples keep of them, and the text file that most datasets bring."""

from math import isfinite
from pathlib import Path

from ..common.errors import RsaDataError
from .listing import lines

# fx, fy, cx, cy in px, each None where unknown.
Camera = tuple[float | None, float | None, float | None, float | None]
UNKNOWN: Camera = (None, None, None, None)


def from_numbers(values: object, where: str) -> Camera:
    """The camera of fx, fy, cx, cy, or of a 3 x 3 matrix as nine numbers or three rows, px."""
    flat: list[object] = []
    for value in values if isinstance(values, (list, tuple)) else [values]:
        flat += value if isinstance(value, (list, tuple)) else [value]
    if len(flat) == 9:
        flat = [flat[0], flat[4], flat[2], flat[5]]
    if len(flat) == 4 and all(isinstance(v, (int, float)) and isfinite(v) for v in flat):
        fx, fy, cx, cy = (float(v) for v in flat)  # type: ignore[arg-type]
        if fx > 0 and fy > 0:
            return fx, fy, cx, cy
    raise RsaDataError(
        f"{where}: expected fx, fy, cx, cy or a 3 x 3 matrix in px, found {values!r:.80}"
    )


def read_matrix(path: Path, name: str) -> Camera:
    """fx, fy, cx, cy in px of a text file with the 3 x 3 camera matrix, three numbers a line."""
    rows = [fields for _, fields in lines(path, name)]
    try:
        k = [float(v) for row in rows for v in row]
    except ValueError:
        k = []
    if len(k) != 9 or not (0 < k[0] < float("inf") and 0 < k[4] < float("inf")):
        raise RsaDataError(
            f"{name}: {path}: expected a 3 x 3 camera matrix in px, found {rows[:3]}"
        )
    return k[0], k[4], k[2], k[5]
