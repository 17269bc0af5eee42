"""Metric depth as bytes of a file: .npy, 16-bit PNG in mm, a picture with a colour bar."""

import io

import numpy as np

from ..pictures.colours import ENDS, depth_colours, range_of


def npy(depth: np.ndarray) -> memoryview:
    """float32 (h, w), m; inf beyond everything, nan unknown."""
    file = io.BytesIO()
    np.save(file, depth.astype(np.float32, copy=False))
    return file.getbuffer()  # without a copy: 100 megapixels are 400 MB


def png(depth: np.ndarray) -> bytes:
    """uint16 (h, w), mm: 0 where unknown, 65535 from 65.535 m on (inf too)."""
    import cv2

    millimetres = np.nan_to_num(depth * 1000.0, nan=0.0, posinf=65535.0)
    image = np.clip(np.rint(millimetres), 0, 65535).astype(np.uint16)
    done, data = cv2.imencode(".png", image)
    assert done
    return data.tobytes()


def beyond(depth: np.ndarray) -> str:
    """That pixels are farther than 16 bits of mm reach, or nothing."""
    far = int((depth > 65.535).sum())
    return f"{far:,} pixels beyond 65.535 m are written as 65535" if far else ""


def picture(pixels: np.ndarray) -> bytes:
    """A PNG of uint8 (h, w, 3), RGB."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


def coloured(depth: np.ndarray, longest: int = 1600) -> np.ndarray:
    """The map in colours with a bar in metres at its right, uint8 (h, w, 3), RGB.

    depth : float (h, w), m. longest : px of the map's longer side at most.
    The colours run from the 2nd to the 98th percentile of the map, widened to round numbers.
    """
    from PIL import Image, ImageDraw

    from ..pictures.drawing import PAPER, SOFT, bar, font, width_of

    zoom = min(1.0, longest / max(depth.shape))
    height, width = (max(1, round(side * zoom)) for side in depth.shape)
    # The nearest pixels first: colours of 100 megapixels would take gigabytes.
    rows, columns = (
        ((np.arange(n) + 0.5) * side / n).astype(int)
        for n, side in zip((height, width), depth.shape, strict=True)
    )
    thin = depth[np.ix_(rows, columns)]
    span, said = range_of(thin), ENDS.rsplit(" ", 1)
    margin = 44 + int(max(*(width_of(label, 13) for label in span.labels), width_of(said[0], 11)))
    tall = max(height, 160)
    page = Image.new("RGB", (width + margin, tall), PAPER)
    page.paste(Image.fromarray(depth_colours(thin, span.high, span.low)), (0, 0))
    draw = ImageDraw.Draw(page)
    bar(draw, width + 12, 8, tall - 48, span.ramp(), span.labels)
    for k, line in enumerate(said):
        draw.text((width + 12, tall - 34 + 14 * k), line, SOFT, font(11))
    return np.asarray(page)
