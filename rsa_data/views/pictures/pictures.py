"""Pictures of what the pipeline holds: segments on an image, depth, predictions beside the truth.

Everything is drawn with NumPy and Pillow; a picture is uint8 of shape (h, w, 3), RGB.
"""

from pathlib import Path

import numpy as np

from ...common import files
from ...common.errors import RsaDataError, UsageError
from ...store.outputs import check_output
from .colours import SEGMENT_COLOURS
from .segments import draw_segments, segment_grid
from .sheet import Prediction, contact_sheet

__all__ = [
    "SEGMENT_COLOURS",
    "Prediction",
    "contact_sheet",
    "draw_segments",
    "save",
    "segment_grid",
]


def save(picture: np.ndarray, path: Path) -> None:
    """Writes a picture as PNG or JPEG, by the file's suffix; parent folders are made."""
    from PIL import Image

    kind = Image.registered_extensions().get(path.suffix.lower())
    if kind not in ("PNG", "JPEG"):
        raise UsageError(f"{path}: expected a name that ends in .png or .jpg")
    check_output(path)
    try:
        with files.replacing(path) as file:
            Image.fromarray(picture).save(file, kind, optimize=True)
    except OSError as error:
        raise RsaDataError(f"{path}: cannot be written: {error.strerror or error}") from error
