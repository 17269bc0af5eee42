"""Text, bars and frames on a canvas: what the pictures are put together from."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from PIL import ImageDraw, ImageFont

INK, SOFT, PAPER = (24, 24, 27), (96, 96, 104), (255, 255, 255)


@cache
def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Pillow's own font, so that no font file is needed."""
    from PIL import ImageFont

    return ImageFont.load_default(size)


def width_of(text: str, size: int) -> float:
    """px that a line of text takes."""
    return float(font(size).getlength(text))


def wrap(text: str, size: int, width: float, lines: int) -> list[str]:
    """Text broken at blanks into at most `lines` lines of at most `width` px.

    A word that is too wide alone is broken; what does not fit ends in "...".
    """
    waiting = [piece for word in text.split() for piece in _pieces(word, size, width)]
    broken: list[str] = []
    while waiting:
        line = waiting.pop(0)
        while waiting and width_of(f"{line} {waiting[0]}", size) <= width:
            line += f" {waiting.pop(0)}"
        if len(broken) == lines - 1 and waiting:
            while line and width_of(line + " ...", size) > width:
                line = line.rpartition(" ")[0]
            return [*broken, f"{line} ...".strip()]
        broken.append(line)
    return broken


def _pieces(word: str, size: int, width: float) -> list[str]:
    pieces = [""]
    for letter in word:
        if pieces[-1] and width_of(pieces[-1] + letter, size) > width:
            pieces.append("")
        pieces[-1] += letter
    return pieces


def resized(picture: np.ndarray, width: int, height: int, smooth: bool = True) -> np.ndarray:
    """A picture of another size; maps are resized without mixing their values."""
    from PIL import Image

    how = Image.Resampling.LANCZOS if smooth else Image.Resampling.NEAREST
    return np.asarray(Image.fromarray(picture).resize((width, height), how))


def bar(
    draw: ImageDraw.ImageDraw,
    x: int,
    y: int,
    height: int,
    colours: np.ndarray,
    labels: tuple[str, ...],
) -> None:
    """A vertical scale 12 px wide: `colours` (n, 3) from bottom to top, labels likewise."""
    for row in range(height):
        place = round((height - 1 - row) / max(height - 1, 1) * (len(colours) - 1))
        r, g, b = (int(c) for c in colours[place])
        draw.line((x, y + row, x + 11, y + row), (r, g, b))
    draw.rectangle((x, y, x + 11, y + height - 1), outline=SOFT)
    for k, label in enumerate(labels):
        level = y + (height - 1) * (1 - k / (len(labels) - 1))
        draw.line((x + 12, level, x + 15, level), SOFT)
        # The outermost labels stay within the bar's ends, so that rows do not run into each other.
        anchor = "ls" if k == 0 else "la" if k == len(labels) - 1 else "lm"
        draw.text((x + 19, level), label, INK, font(13), anchor)


def scatter(
    x: np.ndarray,
    y: np.ndarray,
    colours: np.ndarray,
    line: tuple[float, float] | None = None,
    size: tuple[int, int] = (260, 195),
) -> np.ndarray:
    """Points (n,), (n,) in colours (n, 3), and the line y = line[0] * x + line[1]: uint8 RGB.

    The axes go from the 1st to the 99th percentile, with some room; points beyond are left out.
    """
    from PIL import Image, ImageDraw

    width, height = size
    image = Image.new("RGB", (2 * width, 2 * height), PAPER)
    draw = ImageDraw.Draw(image)

    def place(values: np.ndarray, of: np.ndarray, length: int) -> np.ndarray:
        low, high = np.percentile(of, [1, 99])
        room = 0.08 * max(high - low, 1e-9)
        placed: np.ndarray = (values - low + room) / (high - low + 2 * room) * 2 * length
        return placed

    across, up = place(x, x, width), 2 * height - place(y, y, height)
    if line is not None:
        ends = np.array([x.min(), x.max()])
        heights = 2 * height - place(line[0] * ends + line[1], y, height)
        corners = zip(place(ends, x, width).tolist(), heights.tolist(), strict=True)
        draw.line(list(corners), SOFT, 3)
    for u, v, (r, g, b) in zip(across.tolist(), up.tolist(), colours.tolist(), strict=True):
        draw.ellipse((u - 3, v - 3, u + 3, v + 3), (r, g, b))
    draw.rectangle((0, 0, 2 * width - 1, 2 * height - 1), outline=SOFT)
    return resized(np.asarray(image), width, height)
