"""A kind of input: where its tables lie, and how their rows become rows of features."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ... import registry
from ...store.tables import WorkDir
from .scene import Live

# Options of a stage that change how fast or how exactly something is computed or kept, but not
# what it means.
_INDIFFERENT = ("threads", "store", "runtime", "device")


class Block(Protocol):
    """What one input holds for n images, in their order.

    width : numbers in an image's row, for a set of any length those of one object.
    objects : objects that a row of fixed length has room for, 1 where it is no set.
    there : bool (n,), the images that have this input.
    """

    @property
    def width(self) -> int: ...

    @property
    def objects(self) -> int: ...

    @property
    def there(self) -> np.ndarray: ...

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take, in bytes."""

    def take(self, images: np.ndarray, variants: int | None = None) -> Self:
        """The images at these indices, int64; at most the first so many variants of each."""

    def joined(self, others: Sequence[Self]) -> Self:
        """These images, then those of the others."""

    def rows(self, images: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        """Rows of features, float16 or float32 (b, width), of images that are there.

        drawn : float64 (b,), 0 to below 1: which of an image's variants; 0 for the first.
        """

    def distinct(self) -> np.ndarray:
        """Each stored row of features once, (t, width), for statistics."""


@dataclass(frozen=True)
class Feed:
    """One input of a head on one dataset.

    kind : name in registry.INPUTS. table : what holds the features, embeddings/STYLE/ENCODER or
    another. captions : the table that says which text describes which image, or nothing where
    features are keyed by sample_id.
    """

    kind: str
    table: str
    captions: str = ""

    @property
    def style(self) -> str:
        """Caption style, or the name that stands in its place: embeddings/STYLE/ENCODER."""
        return self.table.split("/")[1]

    @property
    def encoder(self) -> str:
        """Encoder: embeddings/STYLE/ENCODER."""
        return self.table.split("/")[2]

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of all tables read."""
        return (self.captions, self.table) if self.captions else (self.table,)

    def identity(self, work: WorkDir, dataset: str) -> dict[str, Any]:
        """What the features are: style, encoder, its options and the sha256 of its files."""
        own, description = kind(self.kind), work.table(dataset, self.table).description()
        if own.table:
            return {"style": self.kind, "encoder": self.kind, "options": {}, "files": {},
                    "stage_version": description.stage_version}  # fmt: skip
        digest = (description.identity or {}).get("code_sha256")
        return {
            "style": self.style,
            "encoder": self.encoder,
            "options": {k: v for k, v in description.options.items() if k not in _INDIFFERENT},
            # The module of an encoder that is not this package's is one of its files.
            "files": description.files | ({"code": digest} if digest else {}),
            "stage_version": description.stage_version,
        }

    def read(self, work: WorkDir, dataset: str, number: int, variant: int | None = None) -> Block:
        """The input of every row of samples of a part.

        variant : of the captions; None for all. Raises RsaDataError when the tables of the part do
        not belong together.
        """
        return kind(self.kind).read(work, dataset, self, number, variant)


@dataclass(frozen=True)
class Kind:
    """A kind of input.

    read : see `Feed.read`.
    folder : what stands below embeddings/ in the place of a caption style; nothing for captions.
    made_by : command that makes the tables.
    vector : whether heads that read any vector take it.
    table : the one table that it is read from where that is no embeddings table, such as samples.
    live : how its features are made for a photo that is in no table; None where they cannot be.
    """

    read: Callable[[WorkDir, str, Feed, int, int | None], Block]
    folder: str = ""
    made_by: str = ""
    vector: bool = False
    table: str = ""
    live: Live | None = None


def kind(name: str) -> Kind:
    """A kind of input by its name in the registry."""
    found: Kind = registry.resolve("input", registry.INPUTS, name)
    return found


def of_style(style: str | None) -> str:
    """Which kind of input embeddings/STYLE/... are; None, of an imported head, is text.

    style : or the kind itself, where it is read from a table of its own.
    """
    if style and (":" in style or (style in list(registry.INPUTS) and kind(style).table)):
        return style  # no table has a colon in its name
    return next((n for n in registry.INPUTS if style and kind(n).folder == style), "text")


def feed(table: str) -> Feed:
    """The input that a table embeddings/STYLE/ENCODER gives."""
    style = table.split("/")[1]
    name = of_style(style)
    return Feed(name, table, "" if kind(name).folder else f"captions/{style}")


def find(values: Any, among: Any) -> np.ndarray:
    """Row of each value among others, int64, -1 where it is not there."""
    among = among.combine_chunks() if isinstance(among, pa.ChunkedArray) else among
    found = pc.fill_null(pc.index_in(values, value_set=among), -1)
    return np.asarray(found).astype(np.int64)


def ranges(starts: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """start, start + 1, ... of each range, one after another: int64 (sum of counts,)."""
    ends = np.cumsum(counts)
    total = int(ends[-1]) if len(ends) else 0
    return np.asarray(np.arange(total) + np.repeat(starts - (ends - counts), counts))
