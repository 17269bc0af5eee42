"""Training examples from parts: what a head reads of each image, and its pixels."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ...common.errors import RsaDataError
from ...datasets.kitti import CROP
from ...store.tables import WorkDir
from ..belong import Source
from ..inputs.kinds import Block, find


@dataclass(frozen=True)
class Examples:
    """n images with what a head needs of them, all of them valid.

    inputs : what the head reads, in the order in which their rows stand side by side.
    relative : float16 (n, k), y at k valid pixels.
    metric : float16 (n, k), m, ground-truth depth at the same pixels.
    fit : float32 (n, 2), the image's own scale and shift by least squares; nan when it has none.
    share : float32 (n,), valid pixels among those that y covers; nan where the table does not say.
    dataset : int64 (n,), number of the dataset in the run.
    row : int64 (n,), row of the image in its part of samples.
    """

    inputs: tuple[Block, ...]
    relative: np.ndarray
    metric: np.ndarray
    fit: np.ndarray
    share: np.ndarray
    dataset: np.ndarray
    row: np.ndarray

    def __len__(self) -> int:
        return len(self.dataset)

    @property
    def nbytes(self) -> int:
        """Memory that the arrays take, in bytes."""
        # Not the 4 bytes of share, which came later: windows are cut as they were before.
        arrays = (self.relative, self.metric, self.fit, self.dataset, self.row)
        return sum(b.nbytes for b in self.inputs) + sum(a.nbytes for a in arrays)

    def rows(self, images: np.ndarray, drawn: np.ndarray | None = None) -> np.ndarray:
        """Raw rows of features, (b, dim), of images given by their indices; see `Block.rows`."""
        drawn = np.zeros(len(images)) if drawn is None else drawn
        return side_by_side([block.rows(images, drawn) for block in self.inputs])


def side_by_side(rows: Sequence[np.ndarray]) -> np.ndarray:
    """Rows of several inputs as one."""
    return rows[0] if len(rows) == 1 else np.concatenate(rows, 1)


def read_part(work: WorkDir, source: Source, number: int, dataset: int) -> Examples:
    """The images of one part that are ok in every table, in the order of samples.

    Raises RsaDataError when the tables of the part do not belong together, or hold depth that is
    none.
    """
    samples = work.table(source.dataset, "samples").read(number, ["sample_id"])
    table = work.table(source.dataset, source.depth)
    depth = table.read(number)
    depth = depth.filter(pc.equal(depth["status"], "ok"))
    if set(pc.unique(depth["kind"]).to_pylist()) - {"pixels"}:
        raise RsaDataError(
            f"{source.dataset}/{source.depth} part {number}: expected sampled pixels, found whole "
            "maps: this is a test split, which no training may read"
        )
    measured = find(samples["sample_id"], depth["sample_id"])
    blocks = source.read(work, number)
    good = np.flatnonzero(np.all([measured >= 0, *(block.there for block in blocks)], axis=0))
    fits = np.stack([_floats(depth[c]) for c in ("fit_scale", "fit_shift")], 1)
    relative, metric = (_pixels(depth[c])[measured[good]] for c in ("relative", "metric"))
    _check(f"{table} part {number}", samples["sample_id"], good, relative, metric)
    return Examples(
        inputs=tuple(block.take(good) for block in blocks),
        relative=relative,
        metric=metric,
        fit=fits[measured[good]],
        share=_share(depth, table.description().options.get("crop"))[measured[good]],
        dataset=np.full(len(good), dataset),
        row=good,
    )


def select(examples: Examples, keep: np.ndarray, variants: int | None = None) -> Examples:
    """The images `keep` (indices or bools), with only the features that they use.

    variants : keep only so many of each image's first variants.
    """
    keep = np.flatnonzero(keep) if keep.dtype == bool else keep
    return Examples(
        inputs=tuple(block.take(keep, variants) for block in examples.inputs),
        relative=examples.relative[keep],
        metric=examples.metric[keep],
        fit=examples.fit[keep],
        share=examples.share[keep],
        dataset=examples.dataset[keep],
        row=examples.row[keep],
    )


def join(several: Sequence[Examples], pixels: int | None = None) -> Examples:
    """Examples one after another; `pixels` cuts each image's to so many (needed if they differ)."""
    pixels = pixels or min(e.relative.shape[1] for e in several)
    columns = zip(*(e.inputs for e in several), strict=True)
    return Examples(
        inputs=tuple(first.joined(others) for first, *others in columns),
        relative=np.concatenate([e.relative[:, :pixels] for e in several]),
        metric=np.concatenate([e.metric[:, :pixels] for e in several]),
        fit=np.concatenate([e.fit for e in several]),
        share=np.concatenate([e.share for e in several]),
        dataset=np.concatenate([e.dataset for e in several]),
        row=np.concatenate([e.row for e in several]),
    )


def _pixels(column: pa.ChunkedArray) -> np.ndarray:
    """float16 (n, k) of a binary column whose values are equally long."""
    if not len(column):
        return np.empty((0, 0), "<f2")
    array = column.combine_chunks()
    _, offsets, data = array.buffers()
    ends = np.frombuffer(offsets, np.int32, len(array) + 1, array.offset * 4)
    found: np.ndarray = np.frombuffer(data, "<f2")[ends[0] // 2 : ends[-1] // 2]
    return found.reshape(len(array), -1)


def _check(
    where: str, ids: pa.ChunkedArray, rows: np.ndarray, relative: np.ndarray, metric: np.ndarray
) -> None:
    """Raises RsaDataError for images with pixels of no ground truth or no relative depth."""
    # By their bits, which takes a twentieth of the time: positive numbers are 0x0001 to 0x7BFF, and
    # what is no number has all five bits of the exponent.
    ones, others = metric.view("<u2"), relative.view("<u2")
    there = (ones - np.uint16(1) < 0x7BFF) & (others & np.uint16(0x7C00) != 0x7C00)
    wrong = np.flatnonzero(~there.all(1))
    if len(wrong):
        image, pixel = wrong[0], np.flatnonzero(~there[wrong[0]])[0]
        raise RsaDataError(
            f"{where}: expected metric depth above 0 m and a number of relative depth at every "
            f"pixel; found {metric[image, pixel]:g} m and {relative[image, pixel]:g} in "
            f"{ids[int(rows[image])].as_py()}, and {len(wrong) - 1} more images with such pixels. "
            "Make the table again with --start-over"
        )


def _share(depth: pa.Table, crop: str | None) -> np.ndarray:
    """Valid pixels of each image of a depth table among those of the map that y covers."""
    if crop == "kb":
        covered = np.full(len(depth), float(CROP[0] * CROP[1]))
    else:
        covered = _floats(depth["width"]) * _floats(depth["height"])
    return np.asarray(_floats(depth["n_valid"]) / covered, np.float32)


def _floats(column: pa.ChunkedArray) -> np.ndarray:
    """float32, nan for null."""
    found: np.ndarray = pc.fill_null(column.cast(pa.float32()), np.nan).to_numpy()
    return found
