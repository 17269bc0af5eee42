"""The files that RSA released: where its text lies, and what it calls our datasets."""

from collections.abc import Iterator
from pathlib import Path

# Dataset -> folder of the release, where the names differ.
_FOLDERS = {"nyuv2": "nyu"}


def folder_of(dataset: str) -> str:
    """The folder of a dataset in each of the release's folders of text."""
    return _FOLDERS.get(dataset, dataset)


def places(directory: Path, kind: str) -> Iterator[Path]:
    """Where a folder of the release may lie, given what the user named.

    directory : a clone of the RSA repository, its folder `text`, or the folder `kind` itself.
    kind : seg_txt_panoptic or text_all.
    """
    for below in (kind, f"text/{kind}", f"RSA/text/{kind}", "."):
        yield directory / below
