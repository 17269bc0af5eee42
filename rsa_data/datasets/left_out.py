"""The files beside a folder's images that an index leaves out, in one line for people."""

from collections import Counter
from collections.abc import Iterable
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


def told(samples: pa.Table) -> str | None:
    """The line that `note` has left, or None."""
    found = (samples.schema.metadata or {}).get(_KEY)
    return None if found is None else found.decode()
