"""The contact sheet of an evaluation: image, truth, prediction and error of a few samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .colours import ENDS, depth_colours, error_colours, range_of, round_up
from .drawing import INK, PAPER, SOFT, bar, font, resized, width_of, wrap

if TYPE_CHECKING:
    from PIL import Image, ImageDraw

_MARGIN, _GAP, _SCALE = 28, 14, 74
_CELL = 300
_CAPTION, _LINE, _MOST_LINES = 14, 19, 4


@dataclass(frozen=True)
class Prediction:
    """One sample of a contact sheet.

    name : what it is called, for example its sample_id.
    image : uint8 (h, w, 3), RGB.
    caption : the text that the scale and shift were predicted from.
    truth : float32 (height, width), m, 0 where there is none.
    predicted : float32 of truth's shape, m.
    scale : 1/m per unit of y. shift : 1/m.
    abs_rel : the sample's absolute relative error, as evaluated.
    """

    name: str
    image: np.ndarray
    caption: str
    truth: np.ndarray
    predicted: np.ndarray
    scale: float
    shift: float
    abs_rel: float


def contact_sheet(samples: Sequence[Prediction], *, title: str, note: str = "") -> np.ndarray:
    """uint8 (h, w, 3), RGB: a row a sample, truth and prediction on the same colour scale.

    title : the heading. note : a line below it.

    The scale of a row runs from the 2nd to the 98th percentile of its true depths, widened to round
    numbers, as rooms and streets on one scale would show nothing of the rooms; errors are signed,
    and end at the next round number above 98% of them.
    """
    from PIL import Image, ImageDraw

    width = 2 * _MARGIN + 4 * _CELL + 3 * _GAP + 2 * _SCALE
    note = f"{note} Colours of depth: {ENDS} of the truth.".strip()
    notes = wrap(note, 15, width - 2 * _MARGIN, 3)
    head = _MARGIN + 34 + 21 * len(notes) + 40
    captions = [wrap(s.caption, _CAPTION, width - 2 * _MARGIN, _MOST_LINES) for s in samples]
    heights = [round(_CELL * s.truth.shape[0] / s.truth.shape[1]) for s in samples]
    rows = [30 + h + 10 + _LINE * len(c) + 26 for h, c in zip(heights, captions, strict=True)]
    canvas = Image.new("RGB", (width, head + sum(rows) + 6), PAPER)
    draw = ImageDraw.Draw(canvas)
    draw.text((_MARGIN, _MARGIN - 4), title, INK, font(24))
    for k, line in enumerate(notes):
        draw.text((_MARGIN, _MARGIN + 34 + 21 * k), line, SOFT, font(15))
    columns = _columns()
    headings = ("image", "true depth", "predicted depth", "predicted - true depth")
    for x, heading in zip(columns, headings, strict=True):
        draw.text((x, head - 26), heading, INK, font(17))
    y = head
    for sample, caption, height, row in zip(samples, captions, heights, rows, strict=True):
        draw.line((_MARGIN, y, width - _MARGIN, y), (214, 214, 220))
        _row(canvas, draw, sample, y + 8, height)
        for k, line in enumerate(caption):
            draw.text((_MARGIN, y + 30 + height + 12 + _LINE * k), line, INK, font(_CAPTION))
        y += row
    return np.asarray(canvas)


def _columns() -> tuple[int, int, int, int]:
    second = _MARGIN + _CELL + _GAP
    third = second + _CELL + _GAP
    return _MARGIN, second, third, third + _CELL + _SCALE + _GAP


def _row(
    canvas: Image.Image, draw: ImageDraw.ImageDraw, sample: Prediction, y: int, height: int
) -> None:
    from PIL import Image

    numbers = (
        f"AbsRel {sample.abs_rel:.3f}    scale {sample.scale:.4g} 1/m    "
        f"shift {sample.shift:.4g} 1/m"
    )
    draw.text((_MARGIN, y + 1), sample.name, SOFT, font(14))
    right = canvas.width - _MARGIN
    draw.text((right - width_of(numbers, 14), y + 1), numbers, INK, font(14))
    y += 24
    there = sample.truth > 0
    span = range_of(sample.truth)
    error = np.where(there, sample.predicted - sample.truth, np.nan)
    most = round_up(float(np.percentile(np.abs(error[there]), 98))) if there.any() else 1.0
    cells = (
        resized(sample.image, _CELL, height),
        resized(depth_colours(sample.truth, span.high, span.low), _CELL, height, smooth=False),
        resized(depth_colours(sample.predicted, span.high, span.low), _CELL, height, smooth=False),
        resized(error_colours(error, most), _CELL, height, smooth=False),
    )
    columns = _columns()
    for x, cell in zip(columns, cells, strict=True):
        canvas.paste(Image.fromarray(cell), (x, y))
    ramp = np.linspace(0, 1, 256)[None]
    bar(draw, columns[2] + _CELL + 8, y, height, span.ramp(), span.labels)
    labels = (f"-{most:g} m", "0 m", f"+{most:g} m")
    bar(draw, columns[3] + _CELL + 8, y, height, error_colours(2 * ramp - 1, 1.0)[0], labels)
