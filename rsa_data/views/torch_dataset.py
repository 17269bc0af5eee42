"""The tables of a work dir as PyTorch datasets: by index, or as a shuffled, sharded stream."""

import os
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from torch.utils.data import Dataset

from ..common import calls
from ..common.calls import in_python
from ..common.errors import UsageError
from ..heads.belong import Tables
from ..heads.sources import sources
from ..heads.train.examples import Examples, read_part
from ..heads.train.validation_split import by_scene
from ..store.tables import WorkDir
from .open_work import open_dir
from .torch_batches import Item, batch_of, parts_of
from .torch_stream import ShardStream


class ShardDataset(Dataset[Item]):
    """Images of one dataset with the features of their captions and their depth at sampled pixels.

    Item i is a dict of

    - feature : float32 (dim,), raw, of the image's plain caption;
    - relative : float32 (k,), the depth model's raw output at k valid pixels;
    - metric : float32 (k,), m, ground-truth depth at the same pixels;
    - fit : float32 (2,), the image's own scale (1/m per unit of y) and shift (1/m) by least
      squares, nan where there is none;
    - sample_id : str, key of the table samples.

    Only images that are ok in every table are there, in the order of samples. A part is read when
    one of its images is asked for, and the last few stay in memory; for shuffled training over many
    parts use `stream`, which reads each part once an epoch.

    Parameters
    ----------
    work : a work dir, or where it lies.
    dataset : name of the dataset in it.
    style, encoder, depth_model : which tables, where there are several of a kind.
    split : take the parts of this split alone; train by default. Test splits hold whole maps and
        are for `evaluate`.

    Raises UsageError for a choice that is open, RsaDataError for tables that are missing,
    incomplete, or do not belong together.
    """

    @in_python
    def __init__(
        self,
        work: WorkDir | str | os.PathLike[str],
        dataset: str,
        *,
        style: str | None = None,
        encoder: str | None = None,
        depth_model: str | None = None,
        split: str = "train",
    ):
        work = open_dir(work)
        calls.text("ShardDataset: dataset", dataset)
        self.location, self.dataset = work.store.location, dataset
        tables = Tables((dataset,), style, encoder, depth_model)
        self.source = sources(work, tables, "", ())[0]
        self.parts = parts_of(work, self.source, split)
        self._cached = lru_cache(4)(self._read)
        self._ends: np.ndarray | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k != "_cached"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._cached = lru_cache(4)(self._read)

    def __len__(self) -> int:
        return int(self.ends()[-1])

    def __getitem__(self, index: int) -> Item:
        ends = self.ends()
        if not -len(self) <= index < len(self):
            raise IndexError(f"expected an index below {len(self)}, found {index}")
        index %= len(self)
        place = int(np.searchsorted(ends, index, side="right"))
        examples, ids = self._cached(self.parts[place])
        row = index - int(ends[place - 1] if place else 0)
        batch = batch_of(examples, ids, np.array([row]), np.zeros(1))
        return {name: values[0] for name, values in batch.items()}

    def held_out(self, share: float = 0.1) -> np.ndarray:
        """bool (n,): the images that `train-head --validation SHARE` holds out, whole scenes.

        share : more than 0, at most 0.5.
        Raises UsageError for another share, and where all images are of one scene.
        """
        if not isinstance(share, (float, int, np.number)) or not 0 < share <= 0.5:
            raise UsageError(f"held_out: share: expected more than 0, at most 0.5; found {share!r}")
        return by_scene(self.dataset, self.scenes(), share, False)[0]

    def scenes(self) -> np.ndarray:
        """Scene of each item, object (n,): hold out whole scenes, as frames of one look alike."""
        table = WorkDir(self.location).table(self.dataset, "samples")
        return np.concatenate(
            [
                table.read(n, ["scene"])["scene"].to_numpy().astype(object)[self._cached(n)[0].row]
                for n in self.parts
            ]
        )

    def stream(
        self,
        *,
        batch_size: int | None = None,
        shuffle: bool = True,
        window: int = 4,
        seed: int = 0,
        keep: Sequence[bool] | np.ndarray | None = None,
    ) -> ShardStream:
        """An iterable dataset over the parts; see ShardStream."""
        return ShardStream(self, batch_size, shuffle, window, seed, keep)

    def examples(self, number: int) -> tuple[Examples, np.ndarray]:
        """The images of a part that are ok in every table, and their sample_id, object (n,)."""
        return self._cached(number)

    def _read(self, number: int) -> tuple[Examples, np.ndarray]:
        work = WorkDir(self.location)
        found = read_part(work, self.source, number, 0)
        ids = work.table(self.dataset, "samples").read(number, ["sample_id"])["sample_id"]
        return found, ids.to_numpy().astype(object)[found.row]

    def ends(self) -> np.ndarray:
        """int64 (parts,): how many images there are up to the end of each part."""
        if self._ends is None:
            self._ends = np.cumsum([len(self._cached(n)[0]) for n in self.parts])
        return self._ends
