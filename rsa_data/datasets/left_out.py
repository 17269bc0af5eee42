"""What an index leaves out or finds without an image, in one line for people."""

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import PurePosixPath

import pyarrow as pa

from .images import SUFFIXES, readable

_KEY = b"left_out"


def note(samples: pa.Table, names: Iterable[str]) -> pa.Table:
    """The same samples with a line on the files of these names; `told` gives it back."""
    endings = Counter(PurePosixPath(name).suffix.lower() or "no ending" for name in names)
    if not endings:
        return samples
    listed = ", ".join(f"{count} {ending}" for ending, count in sorted(endings.items()))
    line = f"{endings.total()} files beside the images are left out: {listed}"
    if endings.keys() & (SUFFIXES - readable()):
        line += ". Pillow reads HEIC with the package pillow-heif: pip install pillow-heif"
    return samples.replace_schema_metadata({_KEY: line.encode()})


def without_image(
    samples: pa.Table, shard: str, found: Mapping[str, Iterable[str]], image: str | None
) -> pa.Table:
    """The same samples with a line on those of a shard that have no image.

    found : the endings of their members, by key. image : the ending that was asked for.
    """
    if not found:
        return samples
    key, endings = next(iter(found.items()))
    wanted = "that ends like an image" if image is None else f"with the ending {image}"
    line = (
        f"{len(found)} samples of {shard} have no member {wanted}, such as {key}, which has "
        f"{', '.join(endings)}. An ending is all after the first dot of a name; name it by "
        "--dataset-option image=ENDING"
    )
    return samples.replace_schema_metadata({_KEY: line.encode()})


def told(samples: pa.Table) -> str | None:
    """The line that `note` or `without_image` has left, or None."""
    found = (samples.schema.metadata or {}).get(_KEY)
    return None if found is None else found.decode()
