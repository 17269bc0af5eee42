"""Two marks on the depth map: how far they are, how far apart, and a depth that is known."""

from collections.abc import Callable
from html import escape

import numpy as np
from nicegui import ui

from ...common.errors import RsaDataError
from . import desk


class Ruler:
    """The fields below the map, and the marks on it.

    use : (u, v, metres) -> sentence; corrects scale and shift by a known depth.
    undo : back to the words alone. redraw : puts SVG over the map.
    """

    def __init__(
        self,
        use: Callable[[int, int, float], str],
        undo: Callable[[], None],
        redraw: Callable[[str], None],
    ):
        self.use, self.undo, self.redraw = use, undo, redraw
        self.picture: desk.Picture | None = None
        self.depth: np.ndarray | None = None
        self.marks: list[tuple[int, int]] = []

    def build(self) -> None:
        """Puts the fields in their place."""
        names = ("A: column", "A: row", "B: column", "B: row")
        with ui.row().classes("items-center"):
            self.fields = [ui.number(n, min=0, precision=0).classes("w-20") for n in names]
        ui.button("Measure", on_click=self._typed).props("outline")
        self.length = ui.label("No distance yet.").props('role="status"')
        with ui.row().classes("items-center"):
            self.known = ui.number("Known depth at A, m", min=0.01, step=0.1).classes("w-40")
            ui.button("Use it", on_click=self._use).props("outline")
            ui.button("Forget it", on_click=self.undo).props("flat")
        self.refined = ui.label().classes("text-sm").props('role="status"')

    def look_at(self, picture: desk.Picture) -> None:
        """Begins anew with another picture."""
        self.picture, self.depth, self.marks = picture, None, []

    def forget(self) -> None:
        """The known depth does not count any more."""
        self.refined.set_text("")

    def clicked(self, x: float, y: float) -> str:
        """A mark where somebody clicked, px of the map; every third click begins anew."""
        if self.depth is None:
            return ""
        height, width = self.depth.shape
        point = int(np.clip(x, 0, width - 1)), int(np.clip(y, 0, height - 1))
        self.marks = [*self.marks, point] if len(self.marks) == 1 else [point]
        numbers = [number for mark in self.marks for number in mark]
        for field, number in zip(self.fields, numbers, strict=False):
            field.value = number
        return self.measure(self.depth)

    def _typed(self) -> None:
        if self.depth is None:
            ui.notify("Choose a picture with depth first", type="warning")
            return
        height, width = self.depth.shape
        values = [field.value for field in self.fields]
        for value, most in zip(values, (width, height, width, height), strict=True):
            if value is None or not 0 <= value < most:
                text = f"Expected columns below {width} and rows below {height}"
                ui.notify(text, type="warning")
                return
        a, b, c, d = (int(value) for value in values)
        self.marks = [(a, b), (c, d)]
        self.redraw(self.measure(self.depth))

    def measure(self, depth: np.ndarray) -> str:
        """Says how far the marks are and how far apart; gives them as SVG for the map."""
        self.depth = depth
        if self.picture is None:
            return ""
        size = depth.shape[1] / 60
        style = f'stroke="white" stroke-width="{size / 3:.2f}"'
        drawn = [
            f'<circle cx="{u}" cy="{v}" r="{size:.2f}" fill="none" {style}/>'
            f'<text x="{u + 1.4 * size:.1f}" y="{v}" fill="white" font-size="{3 * size:.1f}">'
            f"{escape(name)}</text>"
            for name, (u, v) in zip("AB", self.marks, strict=False)
        ]
        told = [
            f"{name} is {depth[v, u]:.2f} m deep"
            for name, (u, v) in zip("AB", self.marks, strict=False)
        ]
        if len(self.marks) == 2:
            (a, b), (c, d) = self.marks
            drawn.append(f'<line x1="{a}" y1="{b}" x2="{c}" y2="{d}" {style}/>')
            told.append(f"A to B: {desk.distance(self.picture, depth, *self.marks):.2f} m")
        self.length.set_text("; ".join(told) or "No distance yet.")
        lines = "".join(drawn)
        # Once in black below, a little wider: white alone cannot be seen on yellow.
        below = lines.replace("white", "black").replace(f'"{size / 3:.2f}"', f'"{size / 1.5:.2f}"')
        return below.replace("<text ", '<text stroke="black" stroke-width="2" ') + lines

    def _use(self) -> None:
        if not self.marks or not self.known.value:
            ui.notify("Mark a point first, then enter its depth in metres", type="warning")
            return
        try:
            self.refined.set_text(self.use(*self.marks[0], float(self.known.value)))
        except RsaDataError as error:
            ui.notify(str(error), type="negative")
