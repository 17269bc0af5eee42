"""The camera of a photo: from the options, from EXIF data, or assumed."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...common.errors import UsageError
from ...common.numbers import reals
from .choices import View

# Horizontal field of view where nothing tells it, degrees: about that of a phone's main camera.
ASSUMED = 65.0
# Diagonal of 35 mm film, mm: to which a focal length equivalent to 35 mm refers (CIPA DCG-001).
_FILM = float(np.hypot(36, 24))

# EXIF tags (Exif 2.32): the sub-directory, and in it what is read here.
_EXIF, _FOCAL, _FOCAL_35, _RESOLUTION_X, _RESOLUTION_UNIT, _WIDTH = (
    0x8769, 0x920A, 0xA405, 0xA20E, 0xA210, 0xA002
)  # fmt: skip
_MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}


@dataclass(frozen=True)
class Camera:
    """fx, fy, cx, cy in px of an image of this width and height; source : where they are from."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    source: str

    def at(self, width: int, height: int) -> tuple[float, float, float, float]:
        """fx, fy, cx, cy in px of the same view at another size."""
        x, y = width / self.width, height / self.height
        return self.fx * x, self.fy * y, self.cx * x, self.cy * y

    @property
    def view(self) -> float:
        """Horizontal field of view, degrees."""
        return float(np.rad2deg(2 * np.arctan(self.width / 2 / self.fx)))

    def plain(self) -> dict[str, float | int | str]:
        """The same as values of JSON; fov : horizontal field of view, degrees."""
        numbers = {"fov": self.view, "fx": self.fx, "fy": self.fy, "cx": self.cx, "cy": self.cy}
        rounded = {name: float(f"{value:.6g}") for name, value in numbers.items()}
        return {"source": self.source, **rounded, "width": self.width, "height": self.height}


def camera_of(path: Path | None, width: int, height: int, view: View = View()) -> Camera:
    """The camera of a photo of this size, px, as it is meant to be seen (EXIF rotation applied).

    Raises UsageError for options that are not of their form.
    """
    if view.intrinsics is not None and view.fov is not None:
        raise UsageError("--intrinsics and --fov both say what the camera is: leave one out")
    if view.intrinsics is not None:
        return Camera(*_four(view.intrinsics), width, height, "--intrinsics")
    if view.fov is not None:
        if not 1 <= view.fov <= 179:
            raise UsageError(f"--fov: expected 1 to 179 degrees; found {view.fov:g}")
        return _centred(width / 2 / np.tan(np.deg2rad(view.fov) / 2), width, height, "--fov")
    focal, source = _from_exif(path, width, height) if path is not None else (None, "")
    if focal is not None:
        return _centred(focal, width, height, source)
    focal = width / 2 / np.tan(np.deg2rad(ASSUMED) / 2)
    return _centred(focal, width, height, f"assumed field of view of {ASSUMED:g} degrees")


def _centred(focal: float, width: int, height: int, source: str) -> Camera:
    return Camera(float(focal), float(focal), width / 2, height / 2, width, height, source)


def _four(text: str) -> tuple[float, float, float, float]:
    try:
        fx, fy, cx, cy = reals(text, 4)
    except ValueError as error:
        raise UsageError(f"--intrinsics: expected fx,fy,cx,cy in px; found {text!r}") from error
    if max(fx, fy, cx, cy) < 10 and min(fx, fy, cx, cy) > 0:
        raise UsageError(
            f"--intrinsics: expected px of the photo; found {text!r}, which looks like shares of "
            "its width and height: multiply fx and cx by the width, fy and cy by the height"
        )
    if not (1 <= fx < 1e6 and 1 <= fy < 1e6 and abs(cx) < 1e6 and abs(cy) < 1e6):
        raise UsageError(
            "--intrinsics: expected focal lengths of at least 1 px, and all four below 1,000,000; "
            f"found {text!r}"
        )
    return fx, fy, cx, cy


def _from_exif(path: Path, width: int, height: int) -> tuple[float | None, str]:
    """The focal length in px of the image, and what it was taken from; None where EXIF has none."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about large images: nothing is decoded here
            with Image.open(path) as image:
                tags = image.getexif().get_ifd(_EXIF)
    # Pillow's parsers raise nearly every built-in kind on damaged metadata.
    except Exception:
        return None, ""
    diagonal = float(np.hypot(width, height))
    equivalent = _number(tags.get(_FOCAL_35))
    if equivalent is not None and 5 <= equivalent <= 2000:
        return equivalent / _FILM * diagonal, f"EXIF: {equivalent:g} mm equivalent"
    focal, resolution = _number(tags.get(_FOCAL)), _number(tags.get(_RESOLUTION_X))
    unit = _MM_PER_UNIT.get(int(_number(tags.get(_RESOLUTION_UNIT)) or 2))
    taken = _number(tags.get(_WIDTH))
    if focal and resolution and unit and taken:
        # The resolution is that of the sensor's own picture, whose longer side is `taken` or near.
        found = focal * resolution / unit * max(width, height) / max(taken, 1)
        if 0.2 < found / max(width, height) < 100:
            return found, f"EXIF: {focal:g} mm and the sensor's resolution"
    return None, ""


def _number(value: Any) -> float | None:
    """A positive finite number, or None."""
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if 0 < number < float("inf") else None
