"""The page: what stands where, and what happens when somebody touches it. Made with NiceGUI."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import events, run, ui

from ...common.errors import RsaDataError
from ...heads.predict.predict import Prediction
from ..pictures.colours import depth_colours, round_up
from ..pictures.pictures import draw_segments
from . import desk
from .ruler import Ruler

_WIDTH = 460


def serve(models: desk.Models, port: int, show: bool) -> None:
    """Shows the page at 127.0.0.1 until it is stopped; nobody else can reach it."""
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
        self.ruler = Ruler(self._use_known, lambda: self._say(self.found), self._redraw)

    def build(self) -> None:
        """Puts everything in its place."""
        with ui.header().classes("items-center py-2"):
            ui.label(f"rsa-data: head {self.models.name}").classes("text-lg").props(
                "role=heading aria-level=1"
            )
        with ui.row(wrap=False).classes("w-full items-start gap-6"):
            with ui.column().classes("w-80 shrink-0"):
                self._inputs()
            with ui.row().classes("items-start gap-6"):
                with self._part("Photo and segments"):
                    self.photo = ui.interactive_image(size=(_WIDTH, 340)).classes("w-full")
                    self.note = ui.label().classes("text-sm")
                with self._part("Points in metres: drag to turn"):
                    self.space = ui.scene(width=_WIDTH, height=345, grid=False)
                    self.points: Any = None  # of ui.scene, which has no type of its own
                with self._part("Metric depth: click two points"):
                    self.map = ui.interactive_image(
                        size=(_WIDTH, 340), on_mouse=self._marked, cross=True
                    ).classes("w-full")
                    self.range = ui.label().classes("text-sm")
                with self._part("Distances"):
                    self.ruler.build()

    def _part(self, title: str) -> ui.column:
        column = ui.column().style(f"width:{_WIDTH}px")
        with column:
            ui.label(title).classes("font-bold").props("role=heading aria-level=2")
        return column

    def _inputs(self) -> None:
        ids = desk.sample_ids(self.models)
        ui.select(
            ids, label="A sample of the work dir", with_input=True,
            on_change=lambda e: self._open(lambda: desk.of_sample(self.models, e.value)),
        ).classes("w-full").mark("sample")  # fmt: skip
        ui.upload(
            label="or a picture of your own", auto_upload=True, max_file_size=50_000_000,
            on_upload=self._uploaded,
            on_rejected=lambda: ui.notify("Expected one file of at most 50 MB", type="negative"),
        ).classes("w-full")  # fmt: skip
        self.caption = ui.textarea("Caption", on_change=self._worded).classes("w-full")
        self.caption.props("debounce=250 autogrow outlined")
        with ui.card().classes("w-full"):
            self.numbers = ui.label("Write a caption, or choose a picture.").props('role="status"')
            self.spread = ui.label().classes("text-sm")
            self.warning = ui.label().classes("text-sm font-bold text-orange-9").props("role=alert")

    async def _uploaded(self, event: events.UploadEventArguments) -> None:
        data = await event.file.read()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / ("picture" + Path(event.file.name).suffix[:8])
            path.write_bytes(data)
            await self._open(lambda: desk.of_file(self.models, path))

    async def _open(self, load) -> None:
        """Shows a picture; what cannot be read gets a message and changes nothing."""
        try:
            picture: desk.Picture | None = await run.io_bound(load)
        except RsaDataError as error:
            ui.notify(str(error), type="negative", timeout=8000, close_button=True)
            return
        if picture is None:  # the page is being closed
            return
        self.picture = picture
        self.ruler.look_at(picture)
        shown = picture.image
        if picture.segments is not None and len(picture.segments.label):
            shown = draw_segments(shown, picture.segments, width=640)
        self.photo.set_source(_pil(shown))
        said = [picture.why] if picture.why else []
        if picture.guessed:
            said.append("Nothing tells the camera: a view of 65 degrees is assumed.")
        self.note.set_text(" ".join(said))
        if self.caption.value == picture.caption:
            await self._worded()
        self.caption.value = picture.caption

    async def _worded(self) -> None:
        """The caption has changed: ask the head."""
        asked = self.caption.value or ""
        try:
            found: Prediction | None = await run.io_bound(desk.answer, self.models, asked)
        except RsaDataError as error:
            ui.notify(str(error), type="negative")
            return
        if asked == (self.caption.value or ""):  # an answer to older words is not shown
            self._say(found)

    def _say(self, found: Prediction | None) -> None:
        if found is None:
            return
        self.found = found
        self.warning.set_text(
            "This is unlike any caption the head was trained on: do not trust it without a known "
            "depth."
            if found.unlike
            else ""
        )
        self.spread.set_text("")
        if found.spread:
            a, b, c, d = found.spread
            self.spread.set_text(
                f"Objects in other orders: scale {a:.4g} to {b:.4g}, shift {c:.4g} to {d:.4g}"
            )
        self.ruler.forget()
        self._set(found.scale, found.shift)

    def _set(self, scale: float, shift: float) -> None:
        """Shows depth, cloud and distances for a scale and shift."""
        self.numbers.set_text(f"scale {scale:.4g} 1/m per unit of y, shift {shift:.4g} 1/m")
        if self.picture is None or self.picture.y is None:
            return
        depth = desk.depth_of(self.picture, scale, shift)
        seen = depth[np.isfinite(depth) & (depth > 0)]
        top = round_up(float(np.percentile(seen, 98))) if len(seen) else 1.0
        self.map.set_source(_pil(depth_colours(depth, top)))
        low, middle, high = np.percentile(seen, [2, 50, 98]) if len(seen) else (0, 0, 0)
        told = f"Dark 0, bright {top:g} m; most {low:.2f} to {high:.2f}, median {middle:.2f} m."
        if self.picture.truth is not None:
            valid = (self.picture.truth > 0) & np.isfinite(depth)
            truth = self.picture.truth[valid]
            error = np.mean(np.abs(depth[valid] - truth) / truth) if len(truth) else np.nan
            told += f" True median {np.median(truth):.2f} m; AbsRel {error:.3f}."
        self.range.set_text(told)
        self._show_cloud(self.picture, depth)
        self.map.set_content(self.ruler.measure(depth))

    def _show_cloud(self, picture: desk.Picture, depth: np.ndarray) -> None:
        points, colours = desk.cloud(picture, depth)
        if not len(points):
            return
        near, far = -points[:, 2].max(), -points[:, 2].min()
        with self.space:
            if self.points is not None:
                self.points.delete()
            size = max(far, 0.1) / 75
            self.points = self.space.point_cloud(points.tolist(), colours.tolist(), size)
        ahead = {"look_at_x": 0, "look_at_y": 0, "look_at_z": -far / 2}
        self.space.move_camera(0, 0, 0.05 * near, **ahead, up_x=0, up_y=1, up_z=0, duration=0)

    def _redraw(self, drawn: str) -> None:
        self.map.set_content(drawn)

    def _marked(self, event: events.MouseEventArguments) -> None:
        self.map.set_content(self.ruler.clicked(event.image_x, event.image_y))

    def _use_known(self, u: int, v: int, metres: float) -> str:
        """Corrects scale and shift by the depth of a pixel; gives the sentence that says so."""
        if self.found is None or self.picture is None:
            return ""
        self._set(*desk.corrected(self.models, self.found, self.picture, (u, v, metres)))
        return (
            f"Corrected by {metres:g} m at A; from words alone: scale {self.found.scale:.4g}, "
            f"shift {self.found.shift:.4g}"
        )


def _pil(pixels: np.ndarray):
    from PIL import Image

    return Image.fromarray(pixels)
