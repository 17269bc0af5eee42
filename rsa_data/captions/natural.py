"""Texts that people or vision-language models wrote, as a style beside the others.

An importer is an entry of registry.STYLES that is chosen as NAME:PATH. It knows the lines of each
image; line i becomes variant i. Segments are not needed.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from ..common import bounded
from ..common.errors import RsaDataError
from ..common.progress import advance
from ..common.tokenizers import Tokenizer
from ..datasets import rsa_files
from ..datasets.shards import name_of
from . import imports
from .caption_table import caption_table, of_objects
from .imports import Catalogue, Records, lines
from .wordings.wording import NOTHING

VERSION = 1

# A row of samples (sample_id, image) -> the texts of that image, None when none are known.
Reader = Callable[[str, str | None], list[str] | None]
Importer = Callable[[str], Reader | Records]


def reader(found: Reader | Records, catalogue: Catalogue) -> Reader:
    """How to read the texts of one image; records are matched with all images of the dataset."""
    if not isinstance(found, Records):
        return found
    keys, records = found.matched(catalogue), found
    return lambda sample_id, image: records.texts(keys[sample_id]) if sample_id in keys else None


def step(
    style: str, found: Reader | Records, tokenizer: Tokenizer, catalogue: Catalogue | None
) -> Callable[..., pa.Table]:
    """A step from samples (the last input table) to captions.

    catalogue : every sample of the dataset; None: those of the table.

    An image without a text gets "An image."; nothing is known of objects and areas, so they are 0.
    Raises RsaDataError when no image of a part has a text.
    """

    name, _, where = style.partition(":")
    read = None if catalogue is None else reader(found, catalogue)

    def write(*inputs: pa.Table) -> pa.Table:
        samples = inputs[-1]
        ids, images = samples["sample_id"].to_pylist(), samples["image"].to_pylist()
        images = [name_of(image) if image else image for image in images]
        rows = list(zip(ids, images, strict=True))
        look = read or reader(found, rows)
        texts = [look(*row) for row in rows]
        if ids and not any(texts):
            raise RsaDataError(
                f"captions/{name}: expected texts of {ids[0]} and the {len(ids) - 1} other images "
                f"of its part in {where}; found none"
            )
        version = imports.VERSION if isinstance(found, Records) else VERSION
        made = write_texts(name, samples, texts, tokenizer, version)
        advance(len(ids))
        return made

    return write


def write_texts(
    name: str,
    samples: pa.Table,
    found: Sequence[Sequence[str] | None],
    tokenizer: Tokenizer,
    version: int = VERSION,
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
    about = {"style": name, "style_version": str(version), "tokenizer": tokenizer.name}
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
                return lines(base / folder / f"{key}.txt", f"{folder}/{key}.txt")
        raise RsaDataError(
            f"captions/release-text: expected a folder text_all/{folder} below {directory} (or "
            f"below its text or RSA/text); found {', '.join(sorted(known)) or 'none'}. PATH is a "
            "clone of the RSA repository"
        )

    return read


def _folders(base: Path) -> list[str]:
    return [entry.name for entry in base.iterdir() if entry.is_dir()]
