"""Inputs that are one vector an image, or one for each text that describes it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import pyarrow.compute as pc

from ...common.errors import RsaDataError
from ...runner.commands import again
from ...store import schemas
from ...store.tables import WorkDir
from .kinds import Feed, find, ranges


@dataclass(frozen=True)
class Vectors:
    """Vectors of n images.

    features : (t, width), float16 or float32 as stored, raw: one row a distinct text or image.
    index : int64 (v,), rows of `features`: all variants of image 0, then those of image 1 ...
    first : int64 (n + 1,), where each image's variants begin in `index`, and their end.
    """

    features: np.ndarray
    index: np.ndarray
    first: np.ndarray
    objects: int = 1
    width: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "width", self.features.shape[1])

    @property
    def there(self) -> np.ndarray:
        return np.diff(self.first) > 0

    @property
    def nbytes(self) -> int:
        return self.features.nbytes + self.index.nbytes + self.first.nbytes

    def take(self, images: np.ndarray, variants: int | None = None) -> Self:
        counts = np.diff(self.first)[images]
        counts = counts if variants is None else np.minimum(counts, variants)
        used, index = np.unique(self.index[ranges(self.first[images], counts)], return_inverse=True)
        first = np.concatenate([[0], np.cumsum(counts)])
        return type(self)(self.features[used], index, first, self.objects)

    def joined(self, others: Sequence[Self]) -> Self:
        several = [self, *others]
        rows = np.cumsum([0] + [len(v.features) for v in several])
        starts = np.cumsum([0] + [len(v.index) for v in several])
        first = [v.first[:-1] + n for v, n in zip(several, starts, strict=False)]
        return type(self)(
            np.concatenate([v.features for v in several]),
            np.concatenate([v.index + n for v, n in zip(several, rows, strict=False)]),
            np.concatenate([*first, starts[-1:]]),
            self.objects,
        )

    def rows(self, images: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        variant = (drawn * np.diff(self.first)[images]).astype(np.int64)
        found: np.ndarray = self.features[self.index[self.first[images] + variant]]
        return found

    def distinct(self) -> np.ndarray:
        return self.features


def of_captions(
    work: WorkDir, dataset: str, feed: Feed, number: int, variant: int | None
) -> Vectors:
    """The features of the texts that describe each image of a part."""
    ids = work.table(dataset, "samples").read(number, ["sample_id"])["sample_id"]
    embeddings = work.table(dataset, feed.table).read(number)
    captions = work.table(dataset, feed.captions).read(number, ["sample_id", "variant", "text_id"])
    if variant is not None:
        captions = captions.filter(pc.equal(captions["variant"], variant))
    rows = find(captions["text_id"], embeddings["text_id"])
    if (rows < 0).any():
        raise RsaDataError(
            f"{dataset}/{feed.table} part {number}: {int((rows < 0).sum())} captions of "
            f"{feed.captions} have no feature: the captions were made again since. Run "
            f"`{again(work, work.table(dataset, feed.table))}` again"
        )
    image = find(captions["sample_id"], ids)
    counts = np.bincount(image, minlength=len(ids))
    return Vectors(
        schemas.embedding_array(embeddings),
        rows[np.argsort(image, kind="stable")],
        np.concatenate([[0], np.cumsum(counts)]),
    )


def of_images(work: WorkDir, dataset: str, feed: Feed, number: int, variant: int | None) -> Vectors:
    """The feature of each image of a part that has one; variants of captions make no difference."""
    ids = work.table(dataset, "samples").read(number, ["sample_id"])["sample_id"]
    embeddings = work.table(dataset, feed.table).read(number)
    embeddings = embeddings.filter(pc.equal(embeddings["status"], "ok"))
    rows = find(ids, embeddings["sample_id"])
    first = np.concatenate([[0], np.cumsum(rows >= 0)])
    return Vectors(schemas.embedding_array(embeddings), rows[rows >= 0], first)


def of_proposals(
    work: WorkDir, dataset: str, feed: Feed, number: int, variant: int | None
) -> Vectors:
    """The features of an image's objects side by side, as `embed-proposals` writes them."""
    found = of_images(work, dataset, feed, number, variant)
    most = int(work.table(dataset, feed.table).description().options["most"])
    return Vectors(found.features, found.index, found.first, most)
