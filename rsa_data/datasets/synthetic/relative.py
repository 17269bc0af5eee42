"""Relative depth as a frozen model gives it: inverse depth, normalised by the image's content."""

import numpy as np

# Times this, so that y lies where Depth Anything's raw output lies rather than in 0 to 1.
FACTOR = 2.0
# Standard deviation of the smooth multiplicative error, and how many cells it has across.
ERROR, CELLS = 0.03, 5


def relative_depth(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """y, float32 of shape (h, w), from metric depth of that shape, m, inf for the sky.

    Networks trained with a loss that ignores scale and shift (MiDaS, arXiv 1907.01341, eq. 5)
    answer in units of the image's own content: inverse depth minus a shift, over the mean absolute
    deviation from its median. The shift taken here is the inverse depth of the farthest 2% of what
    is not sky, so y is not negative and the sky is 0. The scale and shift that undo this are
    large for near scenes and small for far ones, and y alone does not tell them. On top: a smooth
    error, and outlines that are not quite sharp.
    """
    import cv2

    inverse = 1 / depth
    seen = inverse[np.isfinite(depth)]
    far = np.percentile(seen, 2)
    spread = np.abs(seen - np.median(seen)).mean()
    y = np.maximum(inverse - far, 0) / spread
    h, w = depth.shape
    coarse = rng.standard_normal((max(2, CELLS * h // w), CELLS), np.float32) * ERROR
    error = cv2.resize(coarse, (w, h), interpolation=cv2.INTER_CUBIC)
    y = cv2.GaussianBlur(y.astype(np.float32) * (1 + error), (0, 0), 0.6)
    return np.asarray(FACTOR * y, np.float32)
