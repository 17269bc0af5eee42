"""What a prediction is, as a person reads it and as JSON."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from .camera import Camera
from .objects import Seen

_UNLIKE = "unlike anything the head was trained on; "


# Of a scene in which the segmenter found nothing, for a head that reads its objects only.
NOTHING_FOUND = (
    "no objects were found, so the head was told nothing of this scene: its scale and shift are a "
    "guess; give --caption TEXT, a known point (--known u,v,metres) or other --segments"
)


@dataclass(frozen=True)
class Known:
    """A known distance and what came of it.

    metres : as given. depth : of the result there, m. used : false where it was left out, since it
    contradicts the others. pixel : column and row; None for an end of --range.
    """

    metres: float
    depth: float
    used: bool
    pixel: tuple[float, float] | None

    @property
    def error(self) -> float:
        """Relative error of the result there, + where it is too far."""
        return self.depth / self.metres - 1

    @property
    def name(self) -> str:
        """How a person finds it again."""
        where = "" if self.pixel is None else f" at {self.pixel[0]:g},{self.pixel[1]:g}"
        return f"{self.metres:g} m{where}"

    def plain(self) -> dict[str, Any]:
        """The same as values of JSON."""
        u, v = self.pixel or (None, None)
        return {"u": u, "v": v, "metres": _number(self.metres), "depth": _number(self.depth),
                "residual": _number(self.error), "used": self.used}  # fmt: skip


@dataclass
class Prediction:
    """Scale and shift of a photo or a caption, and what follows from them.

    scale, shift : 1/m per unit of y, and 1/m; nan where there is an error.
    name : of the photo or map, empty without one. caption : None without a head.
    spread : lowest and highest scale and shift over the caption's paraphrases, or None.
    unlike : the caption is farther from the training captions than 99% of those held out.
    notes : how the numbers came about. warnings : what may be wrong with them.
    depth : float32 (h, w), m, or None. image : uint8 (h, w, 3), RGB, or None.
    segmenter : what looked for objects. objects : what it found, largest first; both None where
    nothing looked for any. words : scale and shift of the head alone, before known distances
    correct them; None without a head. known : these distances. files : what was written.
    holds : what files of points and meshes hold and leave out.
    error : why this photo has no prediction.
    """

    caption: str | None
    scale: float = float("nan")
    shift: float = float("nan")
    name: str = ""
    spread: tuple[float, float, float, float] | None = None
    unlike: bool = False
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    depth: np.ndarray | None = None
    image: np.ndarray | None = None
    camera: Camera | None = None
    segmenter: str | None = None
    objects: list[Seen] | None = None
    words: tuple[float, float] | None = None
    known: list[Known] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)
    holds: dict[Path, str] = field(default_factory=dict)
    error: str = ""

    def copy(self) -> "Prediction":
        """Another one with lists of its own."""
        return replace(
            self, notes=[*self.notes], warnings=[*self.warnings], known=[], files=[], holds={}
        )

    @property
    def range(self) -> tuple[float, float, float] | None:
        """Nearest, median and farthest depth, m, of the pixels that have one.

        The 0.5th and 99.5th percentile stand for the ends: single pixels there are often wrong.
        """
        if self.depth is None:
            return None
        good = self.depth[np.isfinite(self.depth) & (self.depth > 0)]
        if not len(good):
            return None
        near, middle, far = np.percentile(good, [0.5, 50, 99.5])
        return float(near), float(middle), float(far)

    @property
    def lines(self) -> list[str]:
        """What a person reads of it."""
        if self.error:
            return [f"{self.name}: {self.error.removeprefix(f'{self.name}: ')}"]
        shown = self.name or repr(self.caption)
        lines = [f"scale {self.scale:.6g}  shift {self.shift:.6g}  {shown}"]
        if self.name and self.caption is not None:
            lines.append(f"  {self.caption!r}")
        if self.spread:
            a, b, c, d = self.spread
            lines.append(
                f"  over its paraphrases: scale {a:.4g} to {b:.4g}, shift {c:.4g} to {d:.4g}"
            )
        lines += [f"  warning: {text}" for text in self.all_warnings]
        lines += [f"  {note}" for note in self.notes]
        if found := self.range:
            near, middle, far = found
            lines.append(
                f"  depth: nearest {near:.2f} m, median {middle:.2f} m, farthest {far:.2f} m"
            )
        lines += [f"  {one.line}" for one in self.objects or ()]
        if self.camera is not None:
            view = f"horizontal field of view {self.camera.view:.1f} degrees"
            assumed = self.camera.source.startswith("assumed")
            lines.append(f"  camera: {self.camera.source}" + ("" if assumed else f", {view}"))
        return lines + [
            f"  wrote {path}" + (f": {self.holds[path]}" if path in self.holds else "")
            for path in self.files
        ]

    @property
    def all_warnings(self) -> list[str]:
        """What may be wrong, that the caption is unlike the training captions among it."""
        way = "do not trust this without a known point (--known u,v,metres)"
        if self.known:
            way = "trust it only as far as the known points bear it out"
        return [*([_UNLIKE + way] if self.unlike else []), *self.warnings]

    def plain(self) -> dict[str, Any]:
        """The same as values of JSON, see docs/metres.md: null where something is not known."""
        found, words, spread = self.range, self.words, self.spread
        said: dict[str, Any] = {
            "image": self.name or None,
            "caption": self.caption,
            "scale": _number(self.scale),
            "shift": _number(self.shift),
            "head": None
            if words is None
            else {"scale": _number(words[0]), "shift": _number(words[1])},
            "spread": None
            if spread is None
            else {"scale": [*map(_number, spread[:2])], "shift": [*map(_number, spread[2:])]},
            "depth": None
            if found is None
            else dict(zip(("min", "median", "max"), map(_number, found), strict=True)),
            "known": [one.plain() for one in self.known],
            "camera": None if self.camera is None else self.camera.plain(),
            "segmenter": self.segmenter,
            "objects": None
            if self.objects is None
            else [
                {"label": o.label, "area": _number(o.area), "distance": _number(o.distance)}
                for o in self.objects
            ],
            "warnings": self.all_warnings,
            "notes": [*self.notes, *(f"{path}: {told}" for path, told in self.holds.items())],
            "files": [str(path) for path in self.files],
        }
        return said | ({"error": self.error} if self.error else {})


def _number(value: float | None) -> float | None:
    """Six digits, as many as float32 has; None where it is not finite."""
    return None if value is None or not np.isfinite(value) else float(f"{value:.6g}")
