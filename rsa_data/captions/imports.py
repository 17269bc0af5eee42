"""Texts in files of others: each record belongs to one image of the whole dataset, or none does."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..common import bounded, text_files
from ..common.errors import RsaDataError
from ..datasets import partners
from . import foreign_texts

VERSION = 2

# sample_id and image of every sample of a dataset, of all parts and splits.
Catalogue = Sequence[tuple[str, str | None]]


_ONLY_NUMBERS = re.compile(r"[\d\s.,eE+-]*\d[\d\s.,eE+-]*")


@dataclass(frozen=True)
class Records:
    """Keys with their texts. shown : the file's or folder's name, for messages."""

    shown: str
    keys: tuple[str, ...]
    texts: Callable[[str], list[str]]

    def matched(self, catalogue: Catalogue) -> dict[str, str]:
        """The key of each sample that has one, by its sample_id.

        A key is a sample_id or the end of one, the end of the image's path, with or without its
        ending, or the image's number; as partners.by_file_name and by_number match them.
        Raises RsaDataError when a record fits several images, or an image several records.
        """
        found: dict[str, str | None] = {}
        images = {image: sample_id for sample_id, image in catalogue if image is not None}
        pairs = [(key, key) for key in self.keys]
        by_id = partners.by_file_name([sample_id for sample_id, _ in catalogue], pairs)
        by_image = partners.by_file_name(images, pairs)
        used = {key for one in (by_id, by_image) for key in one.values()}
        if not used:
            by_image = partners.by_number(images, self.keys)
        elif numbers := [key for key in self.keys if key.isdecimal() and key not in used]:
            left = [image for image in images if image not in by_image]
            by_image |= partners.by_number(left, numbers)
        for sample_id, image in catalogue:
            one = by_image if image in by_image else by_id
            name = image if image in by_image else sample_id
            if name in one:
                key = one[str(name)]
                found[sample_id] = None if key is None else str(key)
        claims = Counter(key for key in found.values() if key is not None)
        unclear = [s for s, key in found.items() if key is None or claims[key] > 1]
        if unclear:
            raise RsaDataError(
                f"captions/import: {self.shown}: expected each text to belong to one image of the "
                f"dataset; found {len(unclear):,} of {len(catalogue):,} images whose text fits "
                f"another one too, or that several fit: {partners.some(sorted(unclear))}. Write "
                "sample_ids, or paths below the dataset's root, as keys"
            )
        return {sample_id: key for sample_id, key in found.items() if key is not None}


def import_texts(argument: str) -> Records:
    """A file with a text for each image (JSON, JSON Lines, CSV, TSV), or a folder of .txt files.

    A key is a sample_id (nyuv2/test/bathroom/rgb_00045), what follows the split in it
    (bathroom/rgb_00045), or the image's path or name, with or without its ending. The forms of
    files are those of `foreign_texts.read`; several texts of a key are its variants, in their
    order. A folder has key.txt or key.caption, one text a line.
    """
    path = Path(argument)
    if path.is_dir():
        return _folder(path)
    if path.suffix.lower() in foreign_texts.SUFFIXES and path.exists():
        texts = foreign_texts.read(path)
        return Records(path.name, tuple(texts), texts.__getitem__)
    raise RsaDataError(
        f"captions/import: expected a file ({', '.join(foreign_texts.SUFFIXES)}) or a folder of "
        f".txt files; found {'another file' if path.exists() else 'nothing'} at {path}"
    )


def _folder(folder: Path) -> Records:
    files = {
        path.relative_to(folder).with_suffix("").as_posix(): path
        for suffix in (".caption", ".txt")  # of both, the later is meant
        for path in sorted(folder.rglob(f"*{suffix}"))
        if not path.is_dir() and not path.name.startswith(".")
    }
    return Records(folder.name, tuple(files), lambda key: _texts(files[key], key))


def _texts(path: Path, key: str) -> list[str]:
    texts = lines(path, f"{key}.txt") or []
    if texts and all(_ONLY_NUMBERS.fullmatch(text) for text in texts):
        raise RsaDataError(
            f"captions/import: {path.name}: expected texts, found only numbers, {texts[0][:60]!r}: "
            "labels of a detector, as YOLO writes them?"
        )
    return texts


def lines(path: Path, shown: str) -> list[str] | None:
    """The lines of a file of texts; None where there is none."""
    try:
        return text_files.lines(bounded.read_text(path))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RsaDataError(f"captions: {shown}: {error.strerror}") from error


def unused(found: object, catalogue: Catalogue | None) -> list[str]:
    """A sentence on records that belong to no image, for the summary.

    found : what an importer gave; records or another reader, of which nothing is known.
    """
    if not isinstance(found, Records) or catalogue is None:
        return []
    left = len(found.keys) - len(found.matched(catalogue))
    if not left:
        return []
    return [
        f"{left:,} of {len(found.keys):,} keys of {found.shown} belong to no image of the "
        "dataset and are left out."
    ]
