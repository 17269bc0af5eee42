"""Which images of a dataset without a split of its own are the test split."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

from ..common.errors import RsaDataError
from .listing import Sample, paths


def held_out_last(found: list[Sample], share: float) -> list[Sample]:
    """Tests on the last scenes that hold `share` of the images; of one scene on its last frames."""
    wanted = round(share * len(found))
    sizes = Counter(s.scene for s in found)  # in the order of first appearance
    if len(sizes) == 1:
        start = len(found) - wanted
        return [replace(s, split="test") if i >= start else s for i, s in enumerate(found)]
    held: set[str] = set()
    images = 0
    for name in reversed(list(sizes)[1:]):
        if images >= wanted:
            break
        held.add(name)
        images += sizes[name]
    return [replace(s, split="test") if s.scene in held else s for s in found]


def held_out_listed(found: list[Sample], listed: Path, name: str) -> list[Sample]:
    """Tests on the images that a list names, one a line; RsaDataError for one that is not there."""
    known = {s.image for s in found}
    held = set()
    for where, path in paths(listed, name):
        if path not in known:
            raise RsaDataError(f"{where}: expected the path of an image, found {path!r}")
        held.add(path)
    return [replace(s, split="test") if s.image in held else s for s in found]
