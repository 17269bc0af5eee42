"""Segments on their image: masks or boxes, names, shares."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...segments.segments import Segments
from .colours import SEGMENT_COLOURS
from .drawing import INK, PAPER, SOFT, font, resized, wrap

if TYPE_CHECKING:
    from PIL import ImageDraw

# px, of a picture of segments and of a cell of a grid: alike, so that text stays sharp.
_WIDTH = 640


def draw_segments(
    image: np.ndarray,
    segments: Segments,
    *,
    masks: Sequence[np.ndarray] | None = None,
    width: int = _WIDTH,
) -> np.ndarray:
    """uint8 (h, w, 3), RGB: each segment in a colour of its own, with its class and share.

    image : uint8 (height, width, 3), RGB, of any size with the segments' aspect.
    masks : bool (height, width) of each segment, tinted instead of its box being framed.
    width : px of the result.

    Labels are put where no other label stands, largest segment first; one that finds no place is
    left out. Without masks, stuff (walls, sky) has no frame, as its box says little: it is named in
    a line below the image, like what has neither box nor mask.
    """
    from PIL import Image, ImageDraw

    height = round(width * image.shape[0] / image.shape[1])
    picture = resized(image, width, height).astype(np.float32)
    order = np.argsort(-np.asarray(segments.area), kind="stable")
    spots: dict[int, tuple[float, float, bool]] = {}
    if masks is not None:
        for k in order:
            mask = resized(masks[k].astype(np.uint8) * 255, width, height, smooth=False) > 0
            if mask.any():
                picture = _tint(picture, mask, SEGMENT_COLOURS[k % len(SEGMENT_COLOURS)])
                spots[k] = *_deepest(mask), True
    canvas = Image.fromarray(picture.astype(np.uint8))
    draw = ImageDraw.Draw(canvas)
    if masks is None and segments.box is not None:
        boxes = segments.box * np.array([width / image.shape[1], height / image.shape[0]] * 2)
        for k in order:
            if segments.is_thing[k]:
                x1, y1, x2, y2 = (float(v) for v in boxes[k])
                draw.rectangle((x1, y1, x2 - 1, y2 - 1), outline=_colour(k), width=3)
                spots[k] = x1, y1, False
    taken: list[tuple[float, float, float, float]] = []
    below = []
    for k in order:
        text = f"{segments.label[k]} {100 * segments.area[k]:.1f}%"
        if segments.score[k] < 1:
            text += f" ({segments.score[k]:.2f})"
        if k in spots:
            _label(draw, text, spots[k], _colour(k), taken, (width, height))
        else:
            below.append(text)
    if not below:
        return np.asarray(canvas)
    lines = wrap(", ".join(below), 16, width - 16, 8)
    taller = Image.new("RGB", (width, height + 12 + 22 * len(lines)), PAPER)
    taller.paste(canvas, (0, 0))
    pen = ImageDraw.Draw(taller)
    for n, line in enumerate(lines):
        pen.text((8, height + 6 + 22 * n), line, INK, font(16))
    return np.asarray(taller)


def segment_grid(pictures: Sequence[tuple[np.ndarray, str]], *, columns: int = 3) -> np.ndarray:
    """uint8 (h, w, 3), RGB: pictures of any size side by side, each with its text below.

    A line break in the text is kept; its first line is the heading.
    """
    from PIL import Image, ImageDraw

    cell, gap = _WIDTH, 16
    shown = [resized(p, cell, round(cell * p.shape[0] / p.shape[1])) for p, _ in pictures]
    texts = [
        [line for part in text.split("\n") for line in wrap(part, 14, cell, 5)]
        for _, text in pictures
    ]
    columns = min(columns, len(shown))
    rows = [range(k, min(k + columns, len(shown))) for k in range(0, len(shown), columns)]
    heights = [max(shown[k].shape[0] + 8 + 19 * len(texts[k]) for k in row) + gap for row in rows]
    canvas = Image.new("RGB", (gap + columns * (cell + gap), gap + sum(heights)), PAPER)
    draw = ImageDraw.Draw(canvas)
    y = gap
    for row, height in zip(rows, heights, strict=True):
        for place, k in enumerate(row):
            x = gap + place * (cell + gap)
            canvas.paste(Image.fromarray(shown[k]), (x, y))
            for n, line in enumerate(texts[k]):
                top = y + shown[k].shape[0] + 6 + 19 * n
                draw.text((x, top), line, SOFT if n == 0 else INK, font(14))
        y += height
    return np.asarray(canvas)


def _colour(k: int) -> tuple[int, int, int]:
    r, g, b = (int(c) for c in SEGMENT_COLOURS[k % len(SEGMENT_COLOURS)])
    return r, g, b


def _deepest(mask: np.ndarray) -> tuple[float, float]:
    """x, y of the mask's pixel that is farthest from its outline: there a label belongs to it."""
    import cv2

    inside = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    y, x = np.unravel_index(inside.argmax(), inside.shape)
    return float(x), float(y)


def _tint(picture: np.ndarray, mask: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """The mask's pixels mixed with the colour, and its outline in it."""
    inner = mask.copy()
    inner[1:] &= mask[:-1]
    inner[:-1] &= mask[1:]
    inner[:, 1:] &= mask[:, :-1]
    inner[:, :-1] &= mask[:, 1:]
    share = np.where(inner, 0.42, np.where(mask, 0.95, 0))[..., None]
    mixed: np.ndarray = picture * (1 - share) + share * colour
    return mixed


def _label(
    draw: ImageDraw.ImageDraw,
    text: str,
    spot: tuple[float, float, bool],
    colour: tuple[int, int, int],
    taken: list[tuple[float, float, float, float]],
    size: tuple[int, int],
) -> None:
    """Text on its colour at the spot, or a little below or above, where nothing stands yet.

    spot : x, y, px, and whether that is the label's middle or its top left corner.
    """
    x1, y1, x2, y2 = draw.textbbox((0, 0), text, font(16))
    w, h = x2 - x1 + 8, y2 - y1 + 8
    left, top = (spot[0] - w / 2, spot[1] - h / 2) if spot[2] else spot[:2]
    x = float(np.clip(left, 0, max(size[0] - w, 0)))
    for step in (0, 1, -1, 2, -2, 3, -3, 4, -4):
        y = float(np.clip(top + step * (h + 2), 0, max(size[1] - h, 0)))
        place = (x, y, x + w, y + h)
        if all(x + w <= a or c <= x or y + h <= b or d <= y for a, b, c, d in taken):
            taken.append(place)
            draw.rectangle(place, fill=colour)
            light = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2] > 128
            draw.text((x + 4 - x1, y + 4 - y1), text, INK if light else PAPER, font(16))
            return
