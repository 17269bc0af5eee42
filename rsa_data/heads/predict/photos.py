"""The photos of a call: files, folders, and videos as folders of their frames."""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from ...common.errors import RsaDataError, UsageError

VIDEOS = frozenset({".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v"})


@dataclass(frozen=True)
class Photo:
    """A photo of a call.

    root, name : it lies at root / name; name is what it is called in the output.
    warning : what is wrong with what it comes from, for the first of its photos.
    """

    root: Path
    name: str
    warning: str = ""

    @property
    def path(self) -> Path:
        """Where it lies."""
        return self.root / self.name


@contextmanager
def opened(places: Iterable[Path]) -> Iterator[list[Photo]]:
    """The photos at some places, a folder's in natural order (2 before 10), hidden files left out.

    The frames of a video lie in a temporary folder, which is deleted at the end.

    Raises UsageError for a place where there is nothing, RsaDataError for an empty folder or a
    video that cannot be read.
    """
    with TemporaryDirectory(prefix="rsa-data-frames-") as temporary:
        photos: list[Photo] = []
        for number, place in enumerate(places):
            if place.suffix.lower() in VIDEOS and place.is_file():
                photos += _frames(place, Path(temporary) / str(number))
            elif place.is_file():
                photos.append(Photo(place.parent, place.name))
            elif place.is_dir():
                photos += _folder(place)
            else:
                raise UsageError(f"{place}: expected an image, a video or a folder; there is none")
        yield photos


def _folder(place: Path) -> list[Photo]:
    from ...datasets.images import SUFFIXES

    names = [
        path.relative_to(place)
        for path in place.rglob("*")
        if path.suffix.lower() in SUFFIXES and path.is_file()
    ]
    names = [name for name in names if not any(part.startswith(".") for part in name.parts)]
    if not names:
        raise RsaDataError(f"{place}: expected images in this folder; found none")
    return [Photo(place, name.as_posix()) for name in sorted(names, key=_natural)]


def _natural(name: Path) -> list[list[tuple[int, int, str]]]:
    """A key by which frame2 comes before frame10."""
    return [
        [(0, int(p), p) if p.isdecimal() else (1, 0, p) for p in re.split(r"([0-9]+)", part)]
        for part in name.parts
    ]


def _frames(video: Path, folder: Path) -> list[Photo]:
    """The frames of a video as PNG files folder / VIDEO / 000001.png."""
    import cv2

    (folder / video.name).mkdir(parents=True)
    reader = cv2.VideoCapture(str(video))
    try:
        announced = int(reader.get(cv2.CAP_PROP_FRAME_COUNT))
        found: list[Photo] = []
        while True:
            good, frame = reader.read()
            if not good:
                break
            name = f"{video.name}/{len(found) + 1:06d}.png"
            # Lossless; the least compression, for the file lives as long as the command.
            cv2.imwrite(str(folder / name), frame, [cv2.IMWRITE_PNG_COMPRESSION, 1])
            found.append(Photo(folder, name))
    finally:
        reader.release()
    if not found:
        raise RsaDataError(f"{video}: expected a video; no frame of it can be read")
    # Containers announce a frame or two more than there are.
    if len(found) < announced - 2:
        ended = f"{video.name} ends early: {len(found)} of its {announced} frames can be read"
        found[0] = Photo(folder, found[0].name, ended)
    return found
