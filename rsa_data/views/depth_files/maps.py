"""Metric depth as bytes of a file: .npy, 16-bit PNG in mm, a picture with a colour bar."""

import io

import numpy as np

from ..pictures.colours import depth_colours, round_up


def npy(depth: np.ndarray) -> bytes:
    """float32 (h, w), m; inf beyond everything, nan unknown."""
    file = io.BytesIO()
    np.save(file, depth.astype(np.float32))
    return file.getvalue()


def png(depth: np.ndarray) -> bytes:
    """uint16 (h, w), mm: 0 where unknown, 65535 from 65.535 m on (inf too)."""
    import cv2

    millimetres = np.nan_to_num(depth * 1000.0, nan=0.0, posinf=65535.0)
    image = np.clip(np.rint(millimetres), 0, 65535).astype(np.uint16)
    done, data = cv2.imencode(".png", image)
    assert done
    return data.tobytes()


def picture(pixels: np.ndarray) -> bytes:
    """A PNG of uint8 (h, w, 3), RGB."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


def top_of(depth: np.ndarray) -> float:
    """The depth at the bright end of the colours, m: most of the map lies below it."""
    good = depth[np.isfinite(depth) & (depth > 0)]
    return round_up(float(np.percentile(good, 98))) if len(good) else 1.0


def coloured(depth: np.ndarray, longest: int = 1600) -> np.ndarray:
    """The map in colours with a bar in metres at its right, uint8 (h, w, 3), RGB.

    depth : float (h, w), m. longest : px of the map's longer side at most.
    """
    from PIL import Image, ImageDraw

    from ..pictures.drawing import PAPER, bar, width_of

    top = top_of(depth)
    zoom = min(1.0, longest / max(depth.shape))
    height, width = (max(1, round(side * zoom)) for side in depth.shape)
    # The nearest pixels first: colours of 100 megapixels would take gigabytes.
    rows, columns = (
        ((np.arange(n) + 0.5) * side / n).astype(int)
        for n, side in zip((height, width), depth.shape, strict=True)
    )
    picture = depth_colours(depth[np.ix_(rows, columns)], top)
    labels = ("0 m", f"{top / 2:g} m", f"{top:g} m")
    margin = 44 + int(max(width_of(label, 13) for label in labels))
    tall = max(height, 80)
    page = Image.new("RGB", (width + margin, tall), PAPER)
    page.paste(Image.fromarray(picture), (0, 0))
    scale = depth_colours(np.linspace(1e-6, top, 256)[None], top)[0]
    bar(ImageDraw.Draw(page), width + 12, 8, tall - 16, scale, labels)
    return np.asarray(page)
