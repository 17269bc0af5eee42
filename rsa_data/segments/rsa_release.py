"""Segments of the released RSA text: one file an image, one line a segment, "CLASS SHARE"."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..common import bounded, class_names, text_files
from ..common.errors import RowError, RsaDataError
from ..common.progress import advance
from ..datasets import rsa_files
from ..datasets.dataset import Dataset
from ..store import schemas
from .segments import Segments, to_table

# Characters. Tokenizers take time by the square of a word's length.
LONGEST_NAME = 200

# The release's folder of segments.
_KIND = "seg_txt_panoptic"


def build(*, argument: str | None, dataset: Dataset, **_: Any) -> Callable[[pa.Table], pa.Table]:
    """rsa-release:DIR: the segments that RSA released; no images needed.

    argument : the folder that `find` takes.
    """
    base = find(argument, dataset)

    def step(samples: pa.Table) -> pa.Table:
        ids = samples["sample_id"].to_pylist()
        found = to_table(ids, (_read(base, sample_id) for sample_id in ids))
        advance(len(ids))
        return found

    return step


def find(argument: str | Path | None, dataset: Dataset) -> Path:
    """The folder of one dataset's released segments, with the splits below it.

    argument : a clone of the RSA repository, its `text` folder, or `seg_txt_panoptic` itself.
    Raises RsaDataError when there is none, naming where was looked.
    """
    if not argument:
        raise RsaDataError(
            "segments/rsa-release: expected the folder of the released text; found none given. "
            "Write rsa-release:DIR, where DIR is a clone of the RSA repository or its text folder"
        )
    directory = Path(argument)
    folder = rsa_files.folder_of(dataset.name)
    for place in rsa_files.places(directory, _KIND):
        if (place / folder).is_dir():
            return place / folder
    raise RsaDataError(
        f"segments/rsa-release: expected a folder {_KIND}/{folder} below {directory} (or below "
        f"its text or RSA/text); found none. DIR is a clone of the RSA repository"
    )


def index_release(directory: str | Path, dataset: Dataset, split: str | None = None) -> pa.Table:
    """The samples that the release has segments of, without any image.

    directory : as in `find`.  split : one split, or None for all.
    Returns a samples table sorted by split and sample_id. Paths follow the dataset's layout;
    sizes and intrinsics are null, as nothing but file names is read.
    Raises RsaDataError when the split is not there or holds no file.
    """
    base = find(directory, dataset)
    splits = sorted(entry.name for entry in base.iterdir() if entry.is_dir())
    if split is not None and split not in splits:
        raise RsaDataError(
            f"segments/rsa-release: expected a split among {', '.join(splits) or 'none'} "
            f"in {base}; found {split!r}"
        )
    rows = [
        (f"{dataset.name}/{name}/{key}", name, key)
        for name in ([split] if split is not None else splits)
        for key in sorted(_keys(base / name))
    ]
    if not rows:
        raise RsaDataError(f"segments/rsa-release: expected .txt files in {base}; found none")
    paths = [dataset.key_paths(name, key) for _, name, key in rows]
    unknown: dict[str, list[None]] = {
        column: [None] * len(rows) for column in ("width", "height", "fx", "fy", "cx", "cy")
    }
    columns = {
        "sample_id": [sample_id for sample_id, _, _ in rows],
        "dataset": [dataset.name] * len(rows),
        "split": [name for _, name, _ in rows],
        "scene": [dataset.scene(key) for _, _, key in rows],
        "image": [image for image, _ in paths],
        "depth": [depth for _, depth in paths],
    }
    return schemas.from_columns("samples", columns | unknown)


def _keys(folder: Path) -> list[str]:
    keys = []
    for where, _, names in os.walk(folder):
        below = Path(where).relative_to(folder).as_posix()
        start = "" if below == "." else below + "/"
        keys += [start + name[:-4] for name in names if name.endswith(".txt")]
    return keys


def _read(base: Path, sample_id: str) -> Segments | RowError:
    where = f"{base.name}/{sample_id.split('/', 1)[1]}.txt"
    try:
        lines = text_files.lines(bounded.read_text(Path(f"{base.parent}/{where}")))
    except FileNotFoundError:
        return RowError(f"segments/rsa-release: {where}: expected this file; found none")
    except bounded.Refused as error:
        return RowError(f"segments/rsa-release: {where}: {error}")
    try:
        return parse(lines)
    except RowError as error:
        return RowError(f"segments/rsa-release: {where} {error}")


def parse(lines: list[str]) -> Segments:
    """Segments from the lines of one released file; blank lines count for nothing.

    The class is all but the last word of a line: "traffic light 0.01" is a traffic light.
    Raises RowError("line 3: ...") at the first line that does not parse.
    """
    labels, areas = [], []
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not words:
            continue
        if len(words) == 1:
            raise RowError(f"line {number}: expected CLASS SHARE, found {words[0]!r}")
        try:
            area = float(words[-1])
        except ValueError:
            area = -1.0
        if not 0 <= area <= 1:
            raise RowError(f"line {number}: area must be a number in [0, 1], found {words[-1]!r}")
        label = " ".join(words[:-1])
        if len(label) > LONGEST_NAME:
            raise RowError(
                f"line {number}: class name of {len(label)} characters: expected at most "
                f"{LONGEST_NAME}"
            )
        labels.append(label)
        areas.append(area)
    count = len(labels)
    return Segments(
        labels,
        np.array(areas, np.float64),
        np.ones(count, np.float32),
        class_names.things(labels),
        None,
        None,
        None,
    )
