"""Datasets: where images and depths lie, what the numbers mean, which pixels count."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa


@dataclass(frozen=True)
class Shards:
    """Files that hold many images each, such as tars; an index reads them one after the other.

    find : root -> their paths below it, sorted. Raises RsaDataError when there is none.
    read : (root, path of one) -> its samples, a table of schemas/samples.toml in its own order.
        Raises RsaDataError for a shard that is damaged.
    """

    find: Callable[[Path], list[str]]
    read: Callable[[Path, str], pa.Table]


@dataclass(frozen=True)
class Dataset:
    """All that the pipeline knows of one dataset.

    name : the name in the registry, in sample_id and in the work dir.
    index : (root, split or None for all) -> samples, a table of schemas/samples.toml sorted by
        split and sample_id. Reads file names and split files, never pixels. Raises RsaDataError
        when root lacks what data/README.md asks for, naming what was expected and found.
    read_depth : path of a ground-truth file -> float32 array of shape (height, width), m,
        0 where there is none. Raises RowError when it cannot be read.
    train_mask : (height, width) -> bool array of that shape, True where training pixels may be
        drawn (borders without ground truth and crops are False).
    key_paths : (split, key) -> (image, depth) paths relative to root, by the dataset's layout,
        either None where the layout does not tell; used when an index comes from text alone.
    scene : key -> scene, what must not be divided between training and validation.
    relative : image -> path of the relative depth that the dataset brings for it (.npy or 16-bit
        PNG, read by the depth model `files`), both relative to root; None when it brings none.
    panoptic : path, relative to root, of the COCO panoptic JSON that the dataset brings: what the
        segmenter `coco-panoptic` reads when it is given no file. None when it brings none.
    prepare : root -> writes the dataset's files where they are missing, for datasets that are made
        and not downloaded; killed half-way it goes on from there. None for all others.
    address : where the files lie when nobody has said so and data/NAME is not there, such as a data
        set of the hub; "" for none.
    test_splits : splits whose depth is stored whole and which no training may read.
    shards : the files that hold the images, where these are no files of their own. An index keeps
        the samples of one shard at a time in memory, and makes no part of images of two, so that a
        worker reads a shard from its front to its end. None for loose files.
    validation_splits : splits by which a training may choose its best epoch, and no more.
    min_depth, max_depth : m, the range in which ground truth counts as valid.
    """

    name: str
    index: Callable[[Path, str | None], pa.Table]
    read_depth: Callable[[Path], np.ndarray]
    min_depth: float
    max_depth: float
    train_mask: Callable[[int, int], np.ndarray] = lambda height, width: np.ones(
        (height, width), bool
    )
    key_paths: Callable[[str, str], tuple[str | None, str | None]] = lambda split, key: (None, None)
    scene: Callable[[str], str] = lambda key: key
    relative: Callable[[str], str] | None = None
    panoptic: str | None = None
    prepare: Callable[[Path], None] | None = None
    shards: Shards | None = None
    address: str = ""
    test_splits: tuple[str, ...] = ("test",)
    validation_splits: tuple[str, ...] = ("val", "validation")

    def role(self, split: str) -> Literal["train", "validation", "test"]:
        """What a split is for: the one rule for heads, constants and comparisons."""
        if split in self.test_splits:
            return "test"
        return "validation" if split in self.validation_splits else "train"
