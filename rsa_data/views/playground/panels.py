"""The parts that the page is put together from: titled panels, pictures, the bar of colours."""

import base64
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from nicegui import ui

from ..pictures.colours import Range

# Side by side where there is room for three, below each other on a phone.
GRID = (
    "display:grid;gap:1rem;width:100%;"
    "grid-template-columns:repeat(auto-fit,minmax(min(100%,310px),1fr))"
)
TALL = 300  # px of an empty panel


def part(title: str) -> ui.column:
    """A column with a title."""
    column = ui.column().classes("gap-1").style("min-width:0")
    with column:
        ui.label(title).classes("font-bold").props("role=heading aria-level=2")
    return column


def empty(text: str, place: ui.element) -> ui.label:
    """What an empty panel says, in its middle."""
    place.classes("relative")
    with place:
        return ui.label(text).classes("absolute top-1/2 left-0 w-full text-center opacity-70")


class Panel:
    """A picture, with a text in its place until there is one."""

    def __init__(self, text: str, **more: Any):
        with ui.element("div").classes("w-full grow").style("min-width:0") as place:
            self.image = ui.interactive_image(size=(400, TALL), **more).classes("w-full")
        self.text = empty(text, place)

    def show(self, pixels: np.ndarray) -> None:
        """Shows uint8 (h, w, 3), RGB; as JPEG, which is made in a tenth of the time of a PNG."""
        from PIL import Image

        file = io.BytesIO()
        Image.fromarray(pixels).save(file, "JPEG", quality=90)
        data = base64.b64encode(file.getvalue()).decode()
        self.image.set_source(f"data:image/jpeg;base64,{data}")
        self.text.set_text("")


class Bar:
    """The colours of depth beside the map, bright and far at its top, with ticks in metres."""

    def __init__(self) -> None:
        colours = Range((0.0, 1.0)).ramp(9)
        stops = ",".join(f"rgb({r},{g},{b})" for r, g, b in colours.tolist())
        with ui.row(wrap=False).classes("gap-1 text-xs shrink-0 items-stretch self-stretch"):
            ui.element("div").style(
                f"width:0.8rem;min-height:{TALL // 2}px;background:linear-gradient(0deg,{stops})"
            ).props('role=img aria-label="colours from near (dark) to far (bright)"')
            self.ticks = ui.column().classes("gap-0 justify-between").style("min-width:2.4rem")

    def show(self, labels: Sequence[str]) -> None:
        """Labels the ticks, given from near to far."""
        self.ticks.clear()
        with self.ticks:
            for label in reversed(labels):
                ui.label(label)
