"""Texts that people or vision-language models wrote, as a style beside the others.

An importer is an entry of registry.STYLES that is chosen as NAME:PATH. It knows the lines of each
image; line i becomes variant i. Segments are not needed.
"""

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..common import bounded, text_files
from ..common.errors import RsaDataError
from ..common.progress import advance
from ..common.tokenizers import Tokenizer
from ..datasets import rsa_files
from ..datasets.shards import name_of
from .caption_table import caption_table, of_objects
from .wordings.wording import NOTHING

VERSION = 1

# A row of samples (sample_id, image) -> the texts of that image, None when none are known.
Reader = Callable[[str, str | None], list[str] | None]
Importer = Callable[[str], Reader]


def step(style: str, read: Reader, tokenizer: Tokenizer) -> Callable[..., pa.Table]:
    """A step from samples (the last input table) to captions.

    An image without a text gets "An image."; nothing is known of objects and areas, so they are 0.
    Raises RsaDataError when no image of a part has a text.
    """

    name, _, where = style.partition(":")

    def write(*inputs: pa.Table) -> pa.Table:
        samples = inputs[-1]
        ids, images = samples["sample_id"].to_pylist(), samples["image"].to_pylist()
        images = [name_of(image) if image else image for image in images]
        found = [read(*row) for row in zip(ids, images, strict=True)]
        if ids and not any(found):
            raise RsaDataError(
                f"captions/{name}: expected texts of {ids[0]} and the {len(ids) - 1} other images "
                f"of its part in {where}; found none"
            )
        made = write_texts(name, samples, found, tokenizer)
        advance(len(ids))
        return made

    return write


def write_texts(
    name: str, samples: pa.Table, found: Sequence[Sequence[str] | None], tokenizer: Tokenizer
) -> pa.Table:
    """A captions table of the texts of each sample; one without any gets "An image."."""
    lines = [_tidy(texts or ()) for texts in found]
    bounded.check_captions((text for group in lines for text in group), f"captions/{name}")
    texts = [text for group in lines for text in group or [NOTHING]]
    sizes = np.array([len(group) or 1 for group in lines], np.int64)
    rows = np.repeat(np.arange(len(samples)), sizes)
    variant = np.arange(len(rows)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    columns = {
        "sample_id": samples["sample_id"].combine_chunks().take(pa.array(rows)),
        "variant": variant,
        "text": pa.array(texts, pa.string()),
        "n_tokens": tokenizer.count(texts),
        **dict.fromkeys(of_objects(), np.zeros(len(rows))),
    }
    about = {"style": name, "style_version": str(VERSION), "tokenizer": tokenizer.name}
    return caption_table(columns, about)


def _tidy(texts: Sequence[str]) -> list[str]:
    """Texts in one line each; those without any character to print are left out."""
    # A lone surrogate, which JSON can spell, has no UTF-8.
    clean = (text.encode("utf-8", "replace").decode() for text in texts)
    joined = (" ".join(text.split()) for text in clean)
    return [text for text in joined if text]


def release_text(argument: str) -> Reader:
    """The release's `text_all`: 15 lines an image, 0 to 9 of a model, 10 to 14 structured.

    argument : a clone of the RSA repository, its `text` folder, or `text_all` itself.
    """
    directory = Path(argument)
    bases = list(rsa_files.places(directory, "text_all"))
    known = {name for base in bases if base.is_dir() for name in _folders(base)}

    def read(sample_id: str, image: str | None) -> list[str] | None:
        name, _, key = sample_id.partition("/")
        folder = rsa_files.folder_of(name)
        for base in bases:
            if (base / folder).is_dir():
                return _lines(base / folder / f"{key}.txt", f"{folder}/{key}.txt")
        raise RsaDataError(
            f"captions/release-text: expected a folder text_all/{folder} below {directory} (or "
            f"below its text or RSA/text); found {', '.join(sorted(known)) or 'none'}. PATH is a "
            "clone of the RSA repository"
        )

    return read


def _folders(base: Path) -> list[str]:
    return [entry.name for entry in base.iterdir() if entry.is_dir()]


def _lines(path: Path, shown: str) -> list[str] | None:
    try:
        return text_files.lines(bounded.read_text(path))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RsaDataError(f"captions: {shown}: {error.strerror}") from error


def import_texts(argument: str) -> Reader:
    """A .json or .csv file of key and text, or a folder of .txt files.

    A key is a sample_id (nyuv2/test/bathroom/rgb_00045), what follows the split in it
    (bathroom/rgb_00045), or the image's path below the dataset's root, with or without its ending.
    JSON: {key: text or list of texts}, or a list of {"key": ..., "text": ...}. CSV: a header with
    the columns key and text. Several texts of a key are its variants, in their order. A folder
    has key.txt, one text a line.
    """
    path = Path(argument)
    look: Callable[[str], list[str] | None]
    if path.is_dir():
        look = partial(_look, path)
    elif path.suffix.lower() in (".json", ".csv") and path.exists():
        look = _read_file(path).get
    else:
        raise RsaDataError(
            f"captions/import: expected a .json or .csv file or a folder of .txt files; found "
            f"{'another file' if path.exists() else 'nothing'} at {path}"
        )

    def read(sample_id: str, image: str | None) -> list[str] | None:
        keys = [sample_id, sample_id.split("/", 2)[-1]]
        if image:
            keys += [image, image.rpartition(".")[0]]
        return next((texts for key in keys if key and (texts := look(key))), None)

    return read


def _look(folder: Path, key: str) -> list[str] | None:
    return _lines(folder / f"{key}.txt", f"{key}.txt")


def _read_file(path: Path) -> Mapping[str, list[str]]:
    texts: dict[str, list[str]] = {}
    try:
        content = bounded.read_text(path, "json")
        if path.suffix.lower() == ".json":
            rows = _json_rows(bounded.parse_json(content))
        else:
            rows = _csv_rows(io.StringIO(content, newline=""))
        for where, key, text in rows:
            if not isinstance(key, str) or not isinstance(text, str):
                raise RsaDataError(
                    f"captions/import: {path.name} {where}: expected a key and a text, found "
                    f"{key!r} and {text!r}"
                )
            texts.setdefault(key.strip("/"), []).append(text)
    except (OSError, ValueError, csv.Error) as error:
        raise RsaDataError(f"captions/import: {path.name} cannot be read: {error}") from error
    return texts


def _json_rows(content: Any) -> list[tuple[str, Any, Any]]:
    if isinstance(content, dict):
        return [
            (f"key {key!r}", key, text)
            for key, texts in content.items()
            for text in (texts if isinstance(texts, list) else [texts])
        ]
    if not isinstance(content, list):
        raise RsaDataError(
            "captions/import: expected a JSON object of key and text, or a list of objects with "
            f"key and text; found {type(content).__name__}"
        )
    pairs = [
        (row.get("key"), row.get("text")) if isinstance(row, dict) else (None, row)
        for row in content
    ]
    return [(f"entry {n}", *pair) for n, pair in enumerate(pairs, 1)]


def _csv_rows(file: Any) -> list[tuple[str, Any, Any]]:
    reader = csv.DictReader(file, strict=True)
    if not {"key", "text"} <= set(reader.fieldnames or ()):
        raise RsaDataError(
            "captions/import: expected a header with the columns key and text; found "
            f"{', '.join(reader.fieldnames or ()) or 'an empty file'}"
        )
    return [(f"line {reader.line_num}", row["key"], row["text"]) for row in reader]
