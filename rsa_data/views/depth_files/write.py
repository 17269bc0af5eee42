"""Which files a prediction is written to, and writing them."""

import re
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ...common.errors import RsaDataError, UsageError
from ...common.files import write
from ...heads.predict.prediction import Prediction
from ...store.outputs import Identity, check_output
from . import maps, space

KINDS = (".npy", ".png", ".ply", ".glb")
# Endings of files that are not written; a folder of such a name would surprise.
_OTHERS = re.compile(
    r"\.(bmp|csv|exr|gif|gltf|h5|jpe?g|json|las|mat|mp4|npz|obj|pcd|pfm|stl|tiff?|txt|usdz|webp|xyz)"
)


@dataclass(frozen=True)
class Outputs:
    """What is written of each photo.

    out : a file NAME.npy (m), .png (16 bits, mm), .ply (coloured points) or .glb (textured mesh);
        any other name is a folder with one depth file for each photo.
    kind : format of the depth files in that folder.
    colours : also write a picture of the depth in colours, with a bar in metres.
    ply : also write coloured points in metres, with x right, y down and z forward.
    glb : also write a textured mesh, cut where the depth jumps.
    """

    out: Path | None = None
    kind: Literal["npy", "png", "ply", "glb"] = "npy"
    colours: bool = False
    ply: bool = False
    glb: bool = False

    def __bool__(self) -> bool:
        return self.out is not None or self.colours or self.ply or self.glb

    @property
    def is_file(self) -> bool:
        """Whether `out` is the depth file itself."""
        return self.out is not None and self.out.suffix.lower() in KINDS


class Writer:
    """Writes the files of one photo after the other; no two photos share a file.

    inputs : files that the command reads, see `outputs.identities`; none of them is written over.
    """

    def __init__(self, outputs: Outputs, inputs: Collection[Identity] = ()):
        self.outputs, self.inputs = outputs, inputs
        self.taken: Counter[Path] = Counter()

    def check(self, names: Iterable[str]) -> None:
        """Raises UsageError, before anything runs, where the files of these photos cannot lie."""
        out = self.outputs.out
        if out is not None and not self.outputs.is_file:
            if _OTHERS.fullmatch(out.suffix.lower()) and not out.is_dir():
                raise UsageError(
                    f"--out {out}: expected a file {', '.join(KINDS)}, or a folder; {out.suffix} "
                    "is not written (--colours writes a picture)"
                )
            if out.exists():
                check_output(out, "--out", folder=True)
        trial = Writer(self.outputs, self.inputs)
        for name in names if self.outputs else ():
            for path in trial._files(name):
                check_output(path, trial._option(path), self.inputs)

    def write(self, p: Prediction) -> None:
        """Writes what was asked for, and names it in `p.files`.

        Raises UsageError when one file is asked for several photos, or for what is read in the same
        call; RsaDataError when it cannot be written.
        """
        if not self.outputs or p.error:
            return
        if p.depth is None:
            raise RsaDataError(f"{p.name or 'predict'}: there is no depth to write")
        for path, kind in self._files(p.name).items():
            check_output(path, self._option(path), self.inputs)
            data, told = _content(p, p.depth, kind, path)
            _save(path, data)
            p.files.append(path)
            p.holds |= {path: told} if told else {}

    def _option(self, path: Path) -> str:
        """How a message names a file: by the option, and where that is a folder by its name too."""
        return "--out" if path == self.outputs.out else "output file"

    def _files(self, name: str | None) -> dict[Path, str]:
        """The files of a photo, and what each of them holds."""
        stem, files = self._stem(name), {}
        if self.outputs.out is not None:
            kind = self.outputs.out.suffix.lower() if self.outputs.is_file else None
            files[_named(stem, kind or f".{self.outputs.kind}")] = kind or f".{self.outputs.kind}"
        if self.outputs.colours:
            files[stem.with_name(f"{stem.name}-colours.png")] = "colours"
        for kind, wanted in ((".ply", self.outputs.ply), (".glb", self.outputs.glb)):
            if wanted:
                files[_named(stem, kind)] = kind
        return files

    def _stem(self, photo: str | None) -> Path:
        """Path of the files without their ending."""
        out = self.outputs.out
        if out is not None and self.outputs.is_file:
            self.taken[out] += 1
            if self.taken[out] > 1:
                raise UsageError(
                    f"--out {out}: one file for several photos: name a folder, without an ending"
                )
            return out.with_suffix("")
        name = Path(photo or "depth")
        stem = (out or Path()) / name.with_suffix("")
        self.taken[stem] += 1
        # a.jpg and a.png: the second one keeps its ending.
        if self.taken[stem] > 1:
            stem = (out or Path()) / name
            self.taken[stem] += 1
            if self.taken[stem] > 1:
                stem = stem.with_name(f"{stem.name}-{self.taken[stem]}")
        return stem


def _named(stem: Path, ending: str) -> Path:
    """`a.jpg.npy` of the stem a.jpg: dots in names stay."""
    return stem.with_name(stem.name + ending)


def _content(
    p: Prediction, depth: np.ndarray, kind: str, path: Path
) -> tuple[bytes | memoryview, str]:
    """The bytes of a file, and what it leaves out, in words."""
    if kind == ".npy":
        return maps.npy(depth), ""
    if kind == ".png":
        return maps.png(depth), maps.beyond(depth)
    if kind == "colours":
        return maps.picture(maps.coloured(depth)), ""
    assert p.camera is not None
    camera = p.camera.at(depth.shape[1], depth.shape[0])
    if kind == ".ply":
        return space.ply(depth, camera, p.image)
    if p.image is None:
        raise UsageError(f"{path}: a textured mesh needs the photo, not its relative depth alone")
    try:
        return space.glb(depth, camera, p.image)
    except ValueError as error:
        raise RsaDataError(f"{path}: {error}") from error


def _save(path: Path, data: bytes | memoryview) -> None:
    try:
        write(path, data)
    except OSError as error:
        raise RsaDataError(f"{path}: cannot be written: {error.strerror or error}") from error
