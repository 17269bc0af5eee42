"""Segments of label maps: PNG files whose pixels are class numbers."""

import contextlib
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import pyarrow as pa

from ..common import class_names, names_files
from ..common.class_names import ClassTable
from ..common.errors import RowError, RsaDataError, UsageError
from ..common.prefetch import each
from ..datasets.dataset import Dataset
from ..datasets.roots import readers
from ..datasets.shards import name_of
from . import maps
from .found import Found, to_segments
from .segments import Segments, to_table

_WHERE = "segments/labels"


def build(
    *,
    argument: str | None,
    dataset: Dataset,
    root: Path | None,
    images: Sequence[str] | None = None,
    names: str | None = None,
    masks: bool = False,
    **_: Any,
) -> Callable[[pa.Table], pa.Table]:
    """labels:DIR: PNG label maps, one segment for each class; --names says what numbers mean.

    argument : DIR, where the map of a/b.jpg is DIR/a/b.png, or a path with one of the fields
        {path} (a/b), {stem} (b), {number} (the digits that b ends in) or {next} (that + 1, for
        files counted from 1), such as DIR/new_nyu_class13_{next:04}.png.
    images : the images of the whole dataset, so that no map belongs to two.
    names : what the numbers mean; see `read_table`.
    """
    if not argument:
        raise UsageError(f"{_WHERE}: write labels:DIR, or labels:DIR/{{stem}}.png and the like")
    template = argument if "{" in argument else f"{argument}/{{path}}.png"
    folder = Path(template.partition("{")[0].rpartition("/")[0] or ".")
    if not folder.is_dir():
        raise RsaDataError(f"{_WHERE}: expected a folder of label maps at {folder}; found none")
    table = read_table(names)
    label_path("a/b1.png", template)

    whole = None if images is None else _owners(images, template)

    def one(image: str | None, owners: Mapping[Path, int]) -> Segments:
        if image is None:
            raise RowError(f"{_WHERE}: no image is listed, so there is no file name to look for")
        path = label_path(image, template)
        try:
            if owners[path] > 1:
                raise RowError(
                    f"expected one image of this label map, found {owners[path]}; write a path "
                    "that tells them apart, such as labels:DIR"
                )
            numbers = maps.fitted(maps.read_numbers(path), root, image, "label map")
            return segments(numbers, table, masks)
        except RowError as error:
            below = path.relative_to(folder).as_posix()
            raise RowError(f"{_WHERE}: {below}: {error}") from error

    def step(samples: pa.Table) -> pa.Table:
        names = samples["image"].to_pylist()
        owners = _owners(names, template) if whole is None else whole
        found = each(lambda image: one(image, owners), names, readers(root))
        return to_table(samples["sample_id"].to_pylist(), found)

    return step


def _owners(images: Iterable[str | None], template: str) -> Counter[Path]:
    """How many images each label map would belong to."""
    owners: Counter[Path] = Counter()
    for image in dict.fromkeys(images):
        with contextlib.suppress(RowError):
            if image is not None:
                owners[label_path(image, template)] += 1
    return owners


def files(*, names: str | None = None, **_: Any) -> dict[str, Path]:
    """The file of names, where they come from one."""
    return {"names": Path(names)} if names and Path(names).is_file() else {}


def read_table(names: str | None) -> ClassTable:
    """The class table of that name, or of that file; see classes.table and classes.read.

    Raises UsageError when none is given, or the name is unknown and no file.
    """
    if names is None:
        raise UsageError(
            f"{_WHERE}: say by --names what the numbers mean: one of "
            f"{', '.join(class_names.known())}, or a file"
        )
    return names_files.read(Path(names)) if Path(names).is_file() else class_names.table(names)


def label_path(image: str, template: str) -> Path:
    """Where the label map of an image lies; raises UsageError for a field that does not exist."""
    below = PurePosixPath(name_of(image)).with_suffix("")
    digits = re.search(r"\d+$", below.name)
    number = int(digits[0]) if digits else -1
    if number < 0 and re.search(r"\{(number|next)", template):
        raise RowError(f"{_WHERE}: expected {below} to end in digits, for {template}")
    fields = {"path": below.as_posix(), "stem": below.name, "number": number, "next": number + 1}
    try:
        return Path(template.format(**fields))
    except (KeyError, IndexError, ValueError) as error:
        raise UsageError(
            f"{_WHERE}: expected the fields {', '.join(fields)} in {template!r}; found {error}"
        ) from error


def segments(numbers: np.ndarray, table: ClassTable, with_masks: bool = False) -> Segments:
    """One segment for each named class of a label map, by class number; shares are exact.

    numbers : int (height, width). 0 and 255 without a name mean unlabelled, any other number
    without a name raises RowError. All segments are stuff: a label map does not tell one chair
    from the next.
    """
    height, width = numbers.shape
    there = np.unique(numbers)
    if strange := [n for n in there.tolist() if n not in table.names and n not in (0, 255)]:
        raise RowError(f"expected class numbers of the table, found {strange[:5]}")
    if table.count == 2 and there.tolist() in ([0, 255], [255]):
        raise RowError(
            "expected the class numbers 0 and 1, found 0 and 255: a mask. Divide it by 255, or "
            "name the class 255 in a table of numbers and names"
        )
    named = np.array([n for n in there.tolist() if n in table.names], np.int64)
    place = np.full(int(numbers.max()) + 1, -1)
    place[named] = np.arange(len(named))
    index, count = place[numbers], len(named)
    found = Found(named, np.ones(count), index=index, is_thing=np.zeros(count, bool))
    return to_segments(found, width, height, table, with_masks=with_masks)
