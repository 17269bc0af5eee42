"""What an evaluation reads of one part: the images' valid pixels, and the features of methods."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..common.errors import RowError, RsaDataError
from ..heads.belong import Source
from ..heads.inputs import kinds
from ..heads.inputs.kinds import Block
from ..heads.train.examples import side_by_side
from ..store.tables import WorkDir
from .oracles import Fits
from .protocols import Rules


@dataclass(frozen=True)
class Image:
    """One image of a test split with the pixels that count.

    row : its place in the part. sample : its row of samples.
    y : float64 of shape (n,), relative depth; gt : float64 of shape (n,), m.
    valid : bool of shape (height, width), the n pixels, row by row, that y and gt hold.
    relative : float16 of shape (height, width), y of the whole image.
    """

    row: int
    sample: dict[str, Any]
    y: np.ndarray
    gt: np.ndarray
    valid: np.ndarray
    relative: np.ndarray

    @cached_property
    def fits(self) -> Fits:
        """What its own ground truth makes of it."""
        return Fits(self.y, self.gt)


@dataclass(frozen=True)
class TestPart:
    """One part of a test split. depth : name of its depth table."""

    __test__ = False  # not a test, whatever pytest thinks of its name

    work: WorkDir
    dataset: str
    number: int
    depth: str

    @cached_property
    def samples(self) -> list[dict[str, Any]]:
        """Rows of samples."""
        rows: list[dict[str, Any]] = (
            self.work.table(self.dataset, "samples").read(self.number).to_pylist()
        )
        return rows

    def seen(self, source: Source, variant: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """What a head reads of each image, float32 (n, dim), and which images have all of it.

        source : the tables of the head's inputs. variant : of the captions. Rows of images that
        lack an input are 0.
        """
        return rows_of(source.read(self.work, self.number, variant))

    def features(
        self, embeddings: str, captions: str | None, variant: int = 0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Features of each image, float32 (n, dim), and which images have one, bool (n,).

        embeddings, captions : table names; without captions, the features are keyed by sample_id.
        """
        feed = kinds.feed(embeddings)
        if captions is not None:
            feed = replace(feed, captions=captions)
        return self.seen(Source(self.dataset, self.depth, (feed,)), variant)

    def images(self, rules: Rules) -> Iterator[tuple[dict[str, Any], Image | RowError | None]]:
        """Each sample with its image, what is wrong with it, or None where there is no depth."""
        table = self.work.table(self.dataset, self.depth).read(self.number)
        if [s["sample_id"] for s in self.samples] != table["sample_id"].to_pylist():
            raise RsaDataError(
                f"{self.dataset}/{self.depth} part {self.number}: its samples are not those of "
                "samples: it belongs to another index"
            )
        for number, sample in enumerate(self.samples):
            row = table.slice(number, 1).to_pylist()[0]
            if row["status"] == "skipped":
                yield sample, None
                continue
            try:
                yield sample, _image(number, sample, row, rules)
            except RowError as error:
                yield sample, error


def rows_of(blocks: Sequence[Block]) -> tuple[np.ndarray, np.ndarray]:
    """What a head reads of n images, float32 (n, dim), and which have all of it, bool (n,).

    blocks : the head's inputs, in its order; captions by their first variant. Rows of images that
    lack an input are 0.
    """
    there = np.all([block.there for block in blocks], axis=0)
    rows = np.flatnonzero(there)
    found = side_by_side([block.rows(rows, np.zeros(len(rows))) for block in blocks])
    features = np.zeros((len(there), found.shape[1]), np.float32)
    features[rows] = found
    return features, there


def _image(number: int, sample: dict[str, Any], row: dict[str, Any], rules: Rules) -> Image:
    if row["status"] == "failed":
        raise RowError(f"depth: {row['error']}")
    if row["kind"] != "map":
        raise RowError("expected a whole map of a test split, found sampled pixels")
    shape = row["height"], row["width"]
    y = np.frombuffer(row["relative"], "<f2").reshape(shape)
    gt = np.frombuffer(row["metric"], "<f2").reshape(shape)
    valid = (gt > rules.min_depth) & (gt < rules.max_depth) & ~np.isnan(y) & rules.region(*shape)
    if not valid.any():
        raise RowError("no valid pixel under this protocol")
    pixels = y[valid].astype(np.float64), gt[valid].astype(np.float64)
    return Image(number, sample, *pixels, valid, y)
