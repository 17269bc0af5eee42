"""Training examples from parts: each image's features of every caption variant, and its pixels."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ...common.errors import RsaDataError
from ...store import schemas
from ...store.tables import WorkDir


@dataclass(frozen=True)
class Source:
    """The tables of one dataset that a head learns from.

    captions is empty when the features belong to images: they are then keyed by sample_id.
    images names a second table, of image features that stand behind those of the text, or nothing.
    """

    dataset: str
    captions: str
    embeddings: str
    depth: str
    images: str = ""


@dataclass(frozen=True)
class Examples:
    """n images with what a head needs of them, all of them valid.

    features : (t, dim), float16 or float32 as stored, raw: one row a distinct text.
    texts : int64 (v,), rows of `features`: all variants of image 0, then those of image 1 ...
    first : int64 (n + 1,), where each image's variants begin in `texts`, and their end.
    relative : float16 (n, k), y at k valid pixels.
    metric : float16 (n, k), m, ground-truth depth at the same pixels.
    fit : float32 (n, 2), the image's own scale and shift by least squares; nan when it has none.
    dataset : int64 (n,), number of the dataset in the run.
    row : int64 (n,), row of the image in its part of samples.
    """

    features: np.ndarray
    texts: np.ndarray
    first: np.ndarray
    relative: np.ndarray
    metric: np.ndarray
    fit: np.ndarray
    dataset: np.ndarray
    row: np.ndarray

    def __len__(self) -> int:
        return len(self.dataset)

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take, in bytes."""
        return sum(getattr(self, name).nbytes for name in self.__dataclass_fields__)


def read_part(work: WorkDir, source: Source, number: int, dataset: int) -> Examples:
    """The images of one part that are ok in every table, in the order of samples.

    Raises RsaDataError when the tables of the part do not belong together.
    """
    samples = work.table(source.dataset, "samples").read(number, ["sample_id"])
    depth = work.table(source.dataset, source.depth).read(number)
    embeddings = work.table(source.dataset, source.embeddings).read(number)
    where = f"{source.dataset}/{source.embeddings} part {number}"

    if source.captions:
        table = work.table(source.dataset, source.captions)
        captions = table.read(number, ["sample_id", "text_id"])
        rows = _find(captions["text_id"], embeddings["text_id"])
        if (rows < 0).any():
            raise RsaDataError(
                f"{where}: {int((rows < 0).sum())} captions of {source.captions} have no feature: "
                "the captions were made again since. Run `rsa-data embed` again"
            )
        image = _find(captions["sample_id"], samples["sample_id"])
    else:
        embeddings = embeddings.filter(pc.equal(embeddings["status"], "ok"))
        rows = np.arange(len(embeddings))
        image = _find(embeddings["sample_id"], samples["sample_id"])
    order = np.argsort(image, kind="stable")
    counts = np.bincount(image, minlength=len(samples))

    depth = depth.filter(pc.equal(depth["status"], "ok"))
    if set(pc.unique(depth["kind"]).to_pylist()) - {"pixels"}:
        raise RsaDataError(
            f"{source.dataset}/{source.depth} part {number}: expected sampled pixels, found whole "
            "maps: this is a test split, which no training may read"
        )
    measured = _find(samples["sample_id"], depth["sample_id"])
    usable = (measured >= 0) & (counts > 0)
    seen = None
    if source.images:
        table = work.table(source.dataset, source.images).read(number)
        table = table.filter(pc.equal(table["status"], "ok"))
        beside = _find(samples["sample_id"], table["sample_id"])
        usable &= beside >= 0
        seen = schemas.embedding_array(table)
    good = np.flatnonzero(usable)
    starts = np.concatenate([[0], np.cumsum(counts)])
    features = schemas.embedding_array(embeddings)
    texts = rows[order][ranges(starts[good], counts[good])]
    if seen is not None:
        image_rows = np.repeat(beside[good], counts[good])
        features = np.concatenate([features[texts], seen[image_rows]], 1)
        texts = np.arange(len(texts))
    return Examples(
        features=features,
        texts=texts,
        first=np.concatenate([[0], np.cumsum(counts[good])]),
        relative=_pixels(depth["relative"])[measured[good]],
        metric=_pixels(depth["metric"])[measured[good]],
        fit=np.stack([_floats(depth[c]) for c in ("fit_scale", "fit_shift")], 1)[measured[good]],
        dataset=np.full(len(good), dataset),
        row=good,
    )


def select(examples: Examples, keep: np.ndarray, variants: int | None = None) -> Examples:
    """The images `keep` (indices or bools), with only the features that they use.

    variants : keep only so many of each image's first variants.
    """
    keep = np.flatnonzero(keep) if keep.dtype == bool else keep
    counts = np.diff(examples.first)[keep]
    counts = counts if variants is None else np.minimum(counts, variants)
    texts = examples.texts[ranges(examples.first[keep], counts)]
    used, texts = np.unique(texts, return_inverse=True)
    return Examples(
        features=examples.features[used],
        texts=texts,
        first=np.concatenate([[0], np.cumsum(counts)]),
        relative=examples.relative[keep],
        metric=examples.metric[keep],
        fit=examples.fit[keep],
        dataset=examples.dataset[keep],
        row=examples.row[keep],
    )


def join(several: Sequence[Examples], pixels: int | None = None) -> Examples:
    """Examples one after another; `pixels` cuts each image's to so many (needed if they differ)."""
    pixels = pixels or min(e.relative.shape[1] for e in several)
    rows = np.cumsum([0] + [len(e.features) for e in several])
    variants = np.cumsum([0] + [len(e.texts) for e in several])
    return Examples(
        features=np.concatenate([e.features for e in several]),
        texts=np.concatenate([e.texts + n for e, n in zip(several, rows, strict=False)]),
        first=np.concatenate(
            [e.first[:-1] + n for e, n in zip(several, variants, strict=False)] + [variants[-1:]]
        ),
        relative=np.concatenate([e.relative[:, :pixels] for e in several]),
        metric=np.concatenate([e.metric[:, :pixels] for e in several]),
        fit=np.concatenate([e.fit for e in several]),
        dataset=np.concatenate([e.dataset for e in several]),
        row=np.concatenate([e.row for e in several]),
    )


def _find(values: pa.ChunkedArray, among: pa.ChunkedArray) -> np.ndarray:
    """Row of each value among others, int64, -1 where it is not there."""
    found = pc.index_in(values, value_set=among.combine_chunks())
    return pc.fill_null(found, -1).to_numpy(zero_copy_only=False).astype(np.int64)


def ranges(starts: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """start, start + 1, ... of each range, one after another: int64 (sum of counts,)."""
    ends = np.cumsum(counts)
    total = int(ends[-1]) if len(ends) else 0
    return np.arange(total) + np.repeat(starts - (ends - counts), counts)


def _pixels(column: pa.ChunkedArray) -> np.ndarray:
    """float16 (n, k) of a binary column whose values are equally long."""
    if not len(column):
        return np.empty((0, 0), "<f2")
    array = column.combine_chunks()
    _, offsets, data = array.buffers()
    ends = np.frombuffer(offsets, np.int32, len(array) + 1, array.offset * 4)
    return np.frombuffer(data, "<f2")[ends[0] // 2 : ends[-1] // 2].reshape(len(array), -1)


def _floats(column: pa.ChunkedArray) -> np.ndarray:
    """float32, nan for null."""
    return pc.fill_null(column, np.nan).to_numpy().astype(np.float32)
