"""The page: what stands where, and what happens when somebody touches it. Made with NiceGUI."""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import app, events, run, ui

from ...common.errors import RsaDataError
from ...heads.predict.prediction import Prediction
from ..pictures.colours import ENDS, depth_colours, range_of
from ..pictures.pictures import draw_segments
from . import desk
from .guard import Guard
from .panels import GRID, Bar, Panel, part
from .ruler import Ruler
from .space import Space

_KINDS = {
    ".npy": "Depth (.npy)",
    ".png": "Depth (.png, mm)",
    "-colours.png": "Colours",
    ".ply": "Points",
    ".glb": "Mesh",
}


def serve(models: desk.Models, port: int, show: bool) -> None:
    """Shows the page at 127.0.0.1 until it is stopped; nobody else can reach it, see guard."""
    app.add_middleware(Guard, port=port)
    ui.run(
        lambda: Page(models).build(), host="127.0.0.1", port=port, show=show, reload=False,
        title=f"rsa-data: {models.name}", dark=None, show_welcome_message=False,
    )  # fmt: skip


class Page:
    """One visitor's page: the picture in view, the words, the marks."""

    def __init__(self, models: desk.Models):
        self.models = models
        self.picture: desk.Picture | None = None
        self.found: Prediction | None = None
        self.depth: np.ndarray | None = None
        self.ruler = Ruler(self._use_known, lambda: self._say(self.found), self._redraw)

    def build(self) -> None:
        """Puts everything in its place."""
        # The photo stands in its own panel: a second, small one would push the others down.
        ui.add_css(".q-uploader__list { display: none }")
        with ui.header().classes("items-center py-1"):
            ui.label(f"rsa-data: head {self.models.name}").classes("text-lg").props(
                "role=heading aria-level=1"
            )
        with ui.element("div").style(GRID):
            self._inputs()
        with ui.element("div").style(GRID):
            with part("Photo and objects"):
                self.photo = Panel("Choose a sample, or a photo of your own.")
                self.note = ui.label().classes("text-sm")
            with part("Metric depth: click two points"):
                with ui.row(wrap=False).classes("w-full gap-2"):
                    self.map = Panel(
                        "Appears with a photo that has relative depth.",
                        on_mouse=self._marked, cross=True,
                    )  # fmt: skip
                    self.bar = Bar()
                self.range = ui.label().classes("text-sm")
            with part("Points in metres: drag to turn"):
                self.space = Space()
                ui.button("Reset view", on_click=self.space.look).props("flat dense")
        with ui.element("div").style(GRID):
            with part("Distances"):
                self.ruler.build()
            with part("Objects"):
                self.objects = ui.label("None yet.").classes("text-sm whitespace-pre-line")
            with part("Files"), ui.row().classes("gap-2"):
                for kind, text in _KINDS.items():
                    ui.button(text, on_click=self._download(kind)).props("outline dense")

    def _inputs(self) -> None:
        ids = desk.sample_ids(self.models)
        with ui.column().classes("gap-2"):
            ui.select(
                ids, label="A sample of the work dir" if ids else "The work dir holds no samples",
                with_input=True,
                on_change=lambda e: self._open(lambda: desk.of_sample(self.models, e.value)),
            ).classes("w-full").mark("sample")  # fmt: skip
            ui.upload(
                label="or a photo of your own", auto_upload=True, max_file_size=50_000_000,
                on_upload=self._uploaded,
                on_rejected=lambda: ui.notify("Expected a file of at most 50 MB", type="negative"),
            ).classes("w-full").props("flat bordered")  # fmt: skip
        kinds = self.models.ask.kinds
        label = "Caption"
        if "text" not in kinds:
            label = "Objects and their shares" if "objects" in kinds else "Not read by this head"
        self.caption = ui.textarea(label, on_change=self._worded).classes("w-full")
        self.caption.props("debounce=250 outlined rows=3")
        with ui.column().classes("gap-1"):
            self.numbers = ui.label("Write a caption, or choose a photo.").props('role="status"')
            self.spread = ui.label().classes("text-sm")
            self.warning = ui.label().classes("text-sm font-bold text-orange-9").props("role=alert")

    async def _uploaded(self, event: events.UploadEventArguments) -> None:
        data = await event.file.read()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "picture"  # a name from outside is not used
            path.write_bytes(data)
            await self._open(lambda: desk.of_file(self.models, path))

    async def _open(self, load: Callable[[], desk.Picture]) -> None:
        """Shows a picture; what cannot be read gets a message and changes nothing."""
        try:
            picture: desk.Picture | None = await run.io_bound(load)
        except RsaDataError as error:
            ui.notify(str(error), type="negative", timeout=8000, close_button=True)
            return
        if picture is None:  # the page is being closed
            return
        self.picture, self.depth = picture, None
        self.space.clear()
        self.ruler.look_at(picture)
        self._show_photo()
        self.note.set_text(
            " ".join([*([picture.why] if picture.why else []), f"Camera: {picture.camera.source}."])
        )
        if self.caption.value == picture.caption:
            await self._worded()
        self.caption.value = picture.caption

    def _show_photo(self) -> None:
        """The photo with its objects, their distances beside the names."""
        assert self.picture is not None
        shown, found = self.picture.image, self.picture.segments
        if found is not None and len(found.label):
            if self.depth is not None:
                # In the order of the segments: largest first is how `objects` has them.
                order = np.argsort(-found.area, kind="stable")
                names = list(found.label)
                for k, one in zip(order, desk.objects(self.picture, self.depth), strict=True):
                    if one.distance is not None:
                        names[k] = f"{one.label} {one.distance:.1f} m"
                found = replace(found, label=names)
            shown = draw_segments(shown, found, width=640)
        self.photo.show(shown)

    async def _worded(self) -> None:
        """The caption has changed: ask the head, then for the spread, which takes longer."""
        asked = self.caption.value or ""
        for spread in (False, True):
            try:
                found: Prediction | None = await run.io_bound(
                    desk.answer, self.models, asked, self.picture, spread
                )
            except RsaDataError as error:
                ui.notify(str(error), type="negative")
                return
            if asked != (self.caption.value or "") or found is None:
                return  # an answer to older words is not shown, nor one to a page being closed
            if spread:
                self._say_spread(found)
            else:
                self._say(found)

    def _say_spread(self, found: Prediction) -> None:
        if found.spread:
            a, b, c, d = found.spread
            self.spread.set_text(
                f"Objects in other orders: scale {a:.4g} to {b:.4g}, shift {c:.4g} to {d:.4g}"
            )

    def _say(self, found: Prediction | None) -> None:
        if found is None:
            return
        self.found = found
        self.warning.set_text(
            "This is unlike any caption the head was trained on: do not trust it without a known "
            "depth."
            if found.unlike
            else " ".join(found.warnings)
        )
        self.spread.set_text(" ".join(found.notes))
        self.ruler.forget()
        self._set(found.scale, found.shift)

    def _set(self, scale: float, shift: float) -> None:
        """Shows depth, cloud and distances for a scale and shift."""
        self.numbers.set_text(f"scale {scale:.4g} 1/m per unit of y, shift {shift:.4g} 1/m")
        if self.picture is None or self.picture.y is None:
            return
        depth = self.depth = desk.depth_of(self.picture, scale, shift)
        seen, span = depth[np.isfinite(depth) & (depth > 0)], range_of(depth)
        self.map.show(depth_colours(depth, span.high, span.low))
        self.bar.show(span.labels)
        low, middle, high = np.percentile(seen, [2, 50, 98]) if len(seen) else (0, 0, 0)
        told = f"Most {low:.2f} to {high:.2f} m ({ENDS}), median {middle:.2f} m."
        if self.picture.truth is not None:
            valid = (self.picture.truth > 0) & np.isfinite(depth)
            truth = self.picture.truth[valid]
            error = np.mean(np.abs(depth[valid] - truth) / truth) if len(truth) else np.nan
            told += f" True median {np.median(truth):.2f} m; AbsRel {error:.3f}."
        self.range.set_text(told)
        self.space.show(self.picture, scale, shift)
        self._show_photo()
        lines = [one.line for one in desk.objects(self.picture, depth)]
        self.objects.set_text("\n".join(lines) or "No objects were found in this photo.")
        self.map.image.set_content(self.ruler.measure(depth))

    def _download(self, kind: str) -> Callable[[], Any]:
        async def download() -> None:
            if self.picture is None or self.depth is None:
                ui.notify("There is no depth yet: choose a photo first", type="warning")
                return
            try:
                data = await run.io_bound(desk.file_of, self.picture, self.depth, kind)
            except ValueError as error:
                ui.notify(f"Cannot be written: {error}", type="negative")
                return
            if data is not None:  # None while the page is being closed
                ui.download.content(data, f"{Path(self.picture.name).stem}{kind}")

        return download

    def _redraw(self, drawn: str) -> None:
        self.map.image.set_content(drawn)

    def _marked(self, event: events.MouseEventArguments) -> None:
        self.map.image.set_content(self.ruler.clicked(event.image_x, event.image_y))

    def _use_known(self, u: int, v: int, metres: float) -> str:
        """Corrects scale and shift by the depth of a pixel; gives the sentence that says so."""
        if self.found is None or self.picture is None:
            return ""
        self._set(*desk.corrected(self.models, self.found, self.picture, (u, v, metres)))
        return (
            f"Corrected by {metres:g} m at A; from words alone: scale {self.found.scale:.4g}, "
            f"shift {self.found.shift:.4g}"
        )
