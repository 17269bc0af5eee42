"""What an evaluation reads of one part: the images' valid pixels, and the features of methods."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ..common.errors import RowError, RsaDataError
from ..store import schemas
from ..store.tables import WorkDir
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
        return self.work.table(self.dataset, "samples").read(self.number).to_pylist()

    def features(
        self, embeddings: str, captions: str | None, variant: int = 0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Features of each image, float32 (n, dim), and which images have one, bool (n,).

        embeddings, captions : table names; without captions, the features are keyed by sample_id.
        variant : of the captions. Rows without a feature are 0.
        """
        table = self.work.table(self.dataset, embeddings).read(self.number)
        stored = schemas.embedding_array(table)
        ids = pa.array([s["sample_id"] for s in self.samples])
        if captions is None:
            rows = rows_of(ids, table["sample_id"])
        else:
            texts = self.work.table(self.dataset, captions).read(
                self.number, ["sample_id", "variant", "text_id"]
            )
            texts = texts.filter(pc.equal(texts["variant"], variant))
            caption = rows_of(ids, texts["sample_id"])
            rows = rows_of(texts["text_id"], table["text_id"])
            if (rows < 0).any():
                raise RsaDataError(
                    f"{self.dataset}/{embeddings} part {self.number}: {int((rows < 0).sum())} "
                    f"captions of {captions} have no feature: the captions were made again since. "
                    "Run `rsa-data embed` again"
                )
            rows = np.where(caption < 0, -1, np.append(rows, -1)[caption])
        there = rows >= 0
        features = np.zeros((len(ids), stored.shape[1]), np.float32)
        features[there] = stored[rows[there]]
        return features, there

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


def rows_of(values: Any, among: Any) -> np.ndarray:
    """Row of each value among others, int64, -1 where it is not there."""
    found = pc.fill_null(pc.index_in(values, value_set=among.combine_chunks()), -1)
    return np.asarray(found).astype(np.int64)
