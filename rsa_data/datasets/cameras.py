"""Camera intrinsics: what samples keep of them, and the text file that most datasets bring."""

from pathlib import Path

from ..common.errors import RsaDataError
from .listing import lines

# fx, fy, cx, cy in px, each None where unknown.
Camera = tuple[float | None, float | None, float | None, float | None]
UNKNOWN: Camera = (None, None, None, None)


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
