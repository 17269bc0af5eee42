"""Which record of a file belongs to which image: exactly one partner each way, or none.

The images are those of the whole dataset, all parts and splits, so that no record stands for two.
"""

import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePosixPath

from ..common.errors import RowError, RsaDataError
from .images import SUFFIXES
from .shards import name_of

# An image_id of a file, as `number_key` gives it.
Key = int | str


def by_file_name(
    images: Iterable[str], records: Sequence[tuple[Key, str]]
) -> dict[str, Key | None]:
    """The record of each image that has one: (record, file name) by the ends of their paths.

    Image and record belong together when the parts of one path are the end of the other's: a
    record may have fewer folders than the image, or more. Backslashes are slashes, accents are
    compared composed (NFC), and endings count only where two files differ in nothing else. Of
    several records the one that shares most parts is meant. None stands for images of which the
    file has several such records, or a record that several images claim. Images without a record
    are left out.
    """
    ends: dict[tuple[str, ...], list[Key]] = {}
    whole: dict[tuple[str, ...], list[Key]] = {}
    for record, name in records:
        parts = _parts(name)
        for key in {parts, _bare(parts)}:
            whole.setdefault(key, []).append(record)
            for start in range(1, len(key)):
                ends.setdefault(key[start:], []).append(record)
    found = {image: _nearest(_parts(image), ends, whole) for image in images}
    claims: dict[Key, int] = {}
    for partners in found.values():
        for record in partners:
            claims[record] = claims.get(record, 0) + 1
    return {
        image: partners[0] if len(partners) == 1 and claims[partners[0]] == 1 else None
        for image, partners in found.items()
        if partners
    }


def _nearest(
    image: tuple[str, ...],
    ends: Mapping[tuple[str, ...], list[Key]],
    whole: Mapping[tuple[str, ...], list[Key]],
) -> list[Key]:
    """The records that share most of their path with an image."""
    for key in (image, _bare(image)):
        found = whole.get(key) or ends.get(key) or []
        if not found:
            starts = (key[start:] for start in range(1, len(key)))
            found = next((whole[end] for end in starts if end in whole), [])
        if found:
            return list(dict.fromkeys(found))
    return []


def _parts(path: str) -> tuple[str, ...]:
    """The folders and the name of a path, as they are compared."""
    plain = unicodedata.normalize("NFC", name_of(path).replace("\\", "/"))
    parts = PurePosixPath(re.sub(r"^[A-Za-z]:/", "", plain)).parts
    return tuple(part for part in parts if part not in ("/", ".", ".."))


def _bare(parts: tuple[str, ...]) -> tuple[str, ...]:
    """The same without an image's ending; names may have dots of their own."""
    stem, dot, ending = (parts[-1] if parts else "").rpartition(".")
    return (*parts[:-1], stem) if stem and (dot + ending).lower() in SUFFIXES else parts


def by_number(images: Iterable[str], numbers: Iterable[Key]) -> dict[str, Key | None]:
    """The image_id of each image that has one, where nothing but the ids tells of images.

    A text is the image's path, name or stem; a number is its stem as a number, or else the digits
    that its stem ends in, as in COCO_val2014_000000000042. None: several images claim that id, or
    several ids that image.
    """
    ids = {number_key(number): number for number in numbers}
    claims: dict[Key, list[str]] = {}
    for image in images:
        bare = _bare(_parts(image))
        stem = bare[-1]
        texts = {"/".join(_parts(image)), "/".join(bare), _parts(image)[-1], stem}
        for key in {number_key(text) for text in texts}:
            claims.setdefault(key, []).append(image)
    for image in [*dict.fromkeys(name for names in claims.values() for name in names)]:
        stem = _bare(_parts(image))[-1]
        digits = re.search(r"\d+$", stem)
        if digits and number_key(stem) not in ids:
            claims.setdefault(int(digits[0]), []).append(image)
    found: dict[str, Key | None] = {}
    for key, number in ids.items():
        claimants = list(dict.fromkeys(claims.get(key, ())))
        for image in claimants:
            found[image] = None if len(claimants) > 1 or image in found else number
    return found


def number_key(number: Key) -> Key:
    """An image_id as it is compared: "007", "7" and 7 are one."""
    text = unicodedata.normalize("NFC", str(number).replace("\\", "/"))
    return int(text) if text.isdecimal() and len(text) < 19 else text


def partner(found: Mapping[str, Key | None], image: str | None, where: str, what: str) -> Key:
    """The one partner of an image in what the functions above gave; RowError when it has none.

    where : the file, what : its records, such as "record", for the message.
    """
    if image is None:
        raise RowError(f"{where}: no image is listed, so there is no file name to look for")
    if image not in found:
        raise RowError(f"{where}: expected a {what} of the image {name_of(image)}, found none")
    if (record := found[image]) is None:
        raise RowError(
            f"{where}: expected one {what} of the image {name_of(image)} and of no other image; "
            "found several that fit by their names"
        )
    return record


def require_some(found: Mapping[str, object], images: Sequence[str], where: str, what: str) -> None:
    """Raises RsaDataError when not one image has a partner: the file is another dataset's."""
    if images and not found:
        raise RsaDataError(
            f"{where}: expected {what} of this dataset's {len(images)} images, such as "
            f"{name_of(images[0])}; found none that belongs to any of them"
        )


def some(values: Iterable[object], most: int = 5) -> str:
    """The first of some values, and how many more there are."""
    listed = list(values)
    more = f" and {len(listed) - most} more" if len(listed) > most else ""
    return ", ".join(map(str, listed[:most])) + more
