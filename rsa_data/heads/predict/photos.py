"""The photos of a call: files, folders, and videos as folders of their frames."""

import re
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ...common.errors import RsaDataError, UsageError

# Frames of a video that lie on the disk at once.
_KEPT = 2

VIDEOS = frozenset({".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v"})


@dataclass(frozen=True)
class Photo:
    """A photo of a call.

    root, name : it lies at root / name; name is what it is called in the output.
    warning : what is wrong with what it comes from, for the first of its photos.
    frame : the video that it is a frame of, and its number from 0.
    """

    root: Path
    name: str
    warning: str = ""
    frame: "tuple[_Video, int] | None" = None

    @property
    def path(self) -> Path:
        """Where it lies, once `fetch` was called."""
        return self.root / self.name

    def fetch(self) -> None:
        """Puts it there where it is a frame of a video; raises RsaDataError where it cannot."""
        if self.frame is not None and not self.path.is_file():
            video, number = self.frame
            video.write(number, self.path)


@contextmanager
def opened(places: Iterable[Path]) -> Iterator[list[Photo]]:
    """The photos at some places, a folder's in natural order (2 before 10), hidden files left out.

    The frames of a video are decoded one after the other, see `Photo.fetch`, into a temporary
    folder, which is deleted at the end.

    Raises UsageError for a place where there is nothing, RsaDataError for an empty folder or a
    video that cannot be read.
    """
    with TemporaryDirectory(prefix="rsa-data-frames-") as temporary:
        photos: list[Photo] = []
        for number, place in enumerate(places):
            if is_video(place):
                photos += _frames(place, Path(temporary) / str(number))
            else:
                photos += _files(place)
        try:
            yield photos
        finally:
            for photo in photos:
                if photo.frame is not None:
                    photo.frame[0].close()


def listed(places: Iterable[Path]) -> list[Photo]:
    """The photos at some places without the frames of videos, which nothing is known of yet."""
    return [photo for place in places if not is_video(place) for photo in _files(place)]


def is_video(place: Path) -> bool:
    """Whether a file lies there that is taken as frames, by its name."""
    return place.suffix.lower() in VIDEOS and place.is_file()


def _files(place: Path) -> list[Photo]:
    if place.is_file():
        return [Photo(place.parent, place.name)]
    if place.is_dir():
        return _folder(place)
    far = re.match(r"[a-z][a-z0-9]+:/", place.as_posix())
    way = ": photos are read from files; download it first" if far else ""
    raise UsageError(f"{place}: expected an image, a video or a folder; there is none{way}")


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


class _Video:
    """The frames of a video, decoded when they are asked for; few of them lie on the disk at once.

    Frames are asked for in order, once or several times over: going back begins again.
    """

    def __init__(self, path: Path):
        self.path = path
        self.at = 0
        self.reader: Any = None
        self.written: deque[Path] = deque()

    def count(self) -> tuple[int, int]:
        """How many frames can be read, and how many the file announces."""
        import cv2

        reader = cv2.VideoCapture(str(self.path))
        try:
            announced, found = int(reader.get(cv2.CAP_PROP_FRAME_COUNT)), 0
            while reader.grab():
                found += 1
        finally:
            reader.release()
        return found, announced

    def write(self, number: int, file: Path) -> None:
        """Writes frame `number`, from 0, as a PNG file; older ones are deleted."""
        import cv2

        if self.reader is None or number < self.at:
            self.close()
            self.reader = cv2.VideoCapture(str(self.path))
        while self.at < number and self.reader.grab():
            self.at += 1
        good, frame = self.reader.read()
        self.at += 1
        if not good:
            raise RsaDataError(f"{self.path.name}: frame {number + 1} cannot be read again")
        # Lossless; the least compression, for the file lives as long as the frame is looked at.
        cv2.imwrite(str(file), frame, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        self.written.append(file)
        while len(self.written) > _KEPT:
            self.written.popleft().unlink(missing_ok=True)

    def close(self) -> None:
        """Lets go of the file."""
        if self.reader is not None:
            self.reader.release()
        self.reader, self.at = None, 0


def _frames(path: Path, folder: Path) -> list[Photo]:
    """The frames of a video as photos folder / VIDEO / 000001.png, which `fetch` makes."""
    video = _Video(path)
    found, announced = video.count()
    if not found:
        raise RsaDataError(f"{path}: expected a video; no frame of it can be read")
    (folder / path.name).mkdir(parents=True)
    # Containers announce a frame or two more than there are.
    early = f"{path.name} ends early: {found} of its {announced} frames can be read"
    return [
        Photo(
            folder,
            f"{path.name}/{number + 1:06d}.png",
            early if number == 0 and found < announced - 2 else "",
            (video, number),
        )
        for number in range(found)
    ]
