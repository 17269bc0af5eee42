"""The tables of a work dir as PyTorch datasets: by index, or as a shuffled, sharded stream."""

import os
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from torch.utils.data import Dataset, IterableDataset

from ..common.errors import UsageError
from ..heads.belong import Tables
from ..heads.sources import sources
from ..heads.train.examples import Examples, join, read_part
from ..heads.train.validation_split import by_scene
from ..store.encoding import fingerprint
from ..store.tables import WorkDir
from .torch_batches import Item, batch_of, parts_of, share_of_work


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
        work = work if isinstance(work, WorkDir) else WorkDir(os.fspath(work))
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

        Raises UsageError where all images are of one scene.
        """
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
    ) -> "ShardStream":
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


class ShardStream(IterableDataset[Item]):
    """A pass over the parts: read once, mixed by windows, divided among workers and ranks.

    Parts are put into an order drawn for the epoch, `window` of them are read together, and their
    images are mixed; each image comes once an epoch, with one of its captions drawn for it. Loader
    workers and ranks of torch.distributed take every n-th part, so they hold different images, and
    where parts do not divide evenly some have one part more.

    batch_size : items come as whole batches, arrays with one more axis and a list of sample_ids;
        give the loader batch_size=None. None: one by one. shuffle : False gives the order of
        samples and caption 0. seed : another one gives other orders. keep : bool (n,), in the
        order of the ShardDataset: leave out the other images.

    `set_epoch` before an epoch begins. `state_dict` and `load_state_dict` continue within an epoch:
    directly where the loader has no workers, and through torchdata's StatefulDataLoader where it
    has some. The same seed, epoch, workers and ranks give the same items.
    """

    def __init__(
        self,
        data: ShardDataset,
        batch_size: int | None,
        shuffle: bool,
        window: int,
        seed: int,
        keep: Sequence[bool] | np.ndarray | None,
    ):
        if window < 1 or (batch_size is not None and batch_size < 1):
            raise UsageError(
                f"stream: expected window and batch_size of 1 or more, found {window}, {batch_size}"
            )
        if keep is not None and len(keep) != len(data):
            raise UsageError(f"stream: keep: expected {len(data)} values, found {len(keep)}")
        self.data, self.batch_size, self.shuffle = data, batch_size, shuffle
        self.window, self.seed = window, seed
        self.keep = None if keep is None else np.asarray(keep, bool)
        self._epoch, self._taken, self._skip = 0, 0, 0
        kept = None if self.keep is None else np.packbits(self.keep).tobytes().hex()
        self._images = fingerprint([data.dataset, data.source.tables, data.parts, kept])

    def set_epoch(self, epoch: int) -> None:
        """Which order the next pass has."""
        self._epoch, self._taken, self._skip = epoch, 0, 0

    def state_dict(self) -> dict[str, Any]:
        """Where this pass is: the epoch, how many images this process has given out, and in what
        order."""
        return self._order() | {"epoch": self._epoch, "taken": self._taken + self._skip}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Makes the next pass go on behind the images that were given out already.

        Raises UsageError for a state of other images, another order or another process.
        """
        for name, value in self._order().items():
            if state.get(name, "none") != value:
                raise UsageError(
                    f"stream: load_state_dict: expected the state of a stream with {name} {value}; "
                    f"found {state.get(name, 'none')}. Make the stream as it was, or begin an epoch"
                )
        epoch, taken = state.get("epoch"), state.get("taken")
        if not all(isinstance(number, int) and number >= 0 for number in (epoch, taken)):
            raise UsageError(
                "stream: load_state_dict: expected an epoch and a number of images taken, each 0 "
                f"or more; found {epoch!r} and {taken!r}"
            )
        self._epoch, self._taken, self._skip = int(epoch), 0, int(taken)  # type: ignore[arg-type]

    def _order(self) -> dict[str, Any]:
        """What decides which images come in which order, but the epoch."""
        mine, of = share_of_work()
        names = ("seed", "window", "batch_size", "shuffle")
        order = {name: getattr(self, name) for name in names}
        return order | {"process": f"{mine} of {of}", "images": self._images}

    def __iter__(self) -> Iterator[Item]:
        skip, self._skip, self._taken = self._skip, 0, 0
        for examples, ids, rows, drawn in self._windows():
            for start in range(0, len(rows), self.batch_size or 1024):
                chosen = slice(start, start + (self.batch_size or 1024))
                count = len(rows[chosen])
                if skip >= self._taken + count:
                    self._taken += count
                    continue
                batch = batch_of(examples, ids, rows[chosen], drawn[chosen])
                if self.batch_size is not None:
                    self._taken += count
                    yield batch
                    continue
                for k in range(count):
                    self._taken += 1
                    if self._taken > skip:
                        yield {name: values[k] for name, values in batch.items()}

    def _windows(self) -> Iterator[tuple[Examples, np.ndarray, np.ndarray, np.ndarray]]:
        """Windows of this process: images, their ids, the order of rows, the caption of each."""
        parts = np.arange(len(self.data.parts))
        if self.shuffle:
            parts = np.random.default_rng((self.seed, self._epoch)).permutation(parts)
        mine, of = share_of_work()
        parts = parts[mine::of]
        for start in range(0, len(parts), self.window):
            chosen = parts[start : start + self.window]
            read = [self.data.examples(self.data.parts[p]) for p in chosen]
            rows = [self._kept(p, len(ids)) for p, (_, ids) in zip(chosen, read, strict=True)]
            begins = np.cumsum([0, *(len(ids) for _, ids in read)])[:-1]
            order = np.concatenate([r + b for r, b in zip(rows, begins, strict=True)])
            examples = join([e for e, _ in read])
            ids = np.concatenate([i for _, i in read])
            drawn = np.zeros(len(order))
            if self.shuffle:
                rng = np.random.default_rng((self.seed, self._epoch, int(chosen[0]) + 1))
                order = rng.permutation(order)
                drawn = rng.random(len(order))
            yield examples, ids, order, drawn

    def _kept(self, place: int, count: int) -> np.ndarray:
        if self.keep is None:
            return np.arange(count)
        end = int(self.data.ends()[place])
        return np.flatnonzero(self.keep[end - count : end])
