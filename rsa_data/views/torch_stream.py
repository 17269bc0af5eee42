"""A shuffled, sharded pass over the parts of a ShardDataset, for PyTorch's loaders."""

import warnings
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np
import torch
from torch.utils.data import IterableDataset, get_worker_info

from ..common import calls
from ..common.errors import UsageError
from ..heads.belong import Source
from ..heads.train.examples import Examples, join
from ..store.encoding import fingerprint
from .torch_batches import Item, batch_of, share_of_work


class Parted(Protocol):
    """What a stream needs of the ShardDataset that it passes over."""

    dataset: str
    source: Source
    parts: list[int]

    def __len__(self) -> int: ...

    def examples(self, number: int) -> tuple[Examples, np.ndarray]: ...

    def ends(self) -> np.ndarray: ...


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

    `set_epoch` before an epoch begins: without it every pass has the same order. `state_dict` and
    `load_state_dict` continue within an epoch: directly where the loader has no workers, and
    through torchdata's StatefulDataLoader where it has some. The same seed, epoch, workers and
    ranks give the same items. How many batches there are depends on the loader's workers, as each
    ends its windows with a smaller one, so that a stream and its loader have no length.
    """

    def __init__(
        self,
        data: Parted,
        batch_size: int | None,
        shuffle: bool,
        window: int,
        seed: int,
        keep: Sequence[bool] | np.ndarray | None,
    ):
        self.data, self.shuffle = data, shuffle
        self.batch_size = batch_size
        if batch_size is not None:
            self.batch_size = calls.whole("stream: batch_size", batch_size, 1)
        self.window = calls.whole("stream: window", window, 1)
        self.seed = calls.whole("stream: seed", seed, 0)
        self.keep = None if keep is None else _bools(keep, len(data))
        self._epoch, self._taken, self._skip = 0, 0, 0
        kept = None if self.keep is None else np.packbits(self.keep).tobytes().hex()
        self._images = fingerprint([data.dataset, data.source.tables, data.parts, kept])
        # Shared with the copies that loader workers iterate.
        self._in_workers = torch.zeros(1, dtype=torch.bool)
        self._in_workers.share_memory_()  # type: ignore[no-untyped-call]

    def set_epoch(self, epoch: int) -> None:
        """Which order the next pass has."""
        self._epoch, self._taken, self._skip = calls.whole("set_epoch", epoch, 0), 0, 0
        self._in_workers.zero_()

    def state_dict(self) -> dict[str, Any]:
        """Where this pass is: the epoch, how many images this process has given out, and in what
        order.

        Raises UsageError in the main process while loader workers iterate copies of the stream,
        whose states it cannot know.
        """
        if get_worker_info() is None and self._in_workers.item():
            raise UsageError(
                "state_dict: loader workers iterate copies of this stream: ask torchdata's "
                "StatefulDataLoader for the state of all of them (docs/pytorch.md), or use a "
                "loader without workers"
            )
        return self._order() | {"epoch": self._epoch, "taken": self._taken + self._skip}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Makes the next pass go on behind the images that were given out already.

        Raises UsageError for a state of other images, another order or another process.
        """
        if not isinstance(state, dict):
            raise UsageError(f"load_state_dict: expected what state_dict gave; found {state!r:.80}")
        self._in_workers.zero_()
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
        if get_worker_info() is not None:
            self._in_workers.fill_(True)
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
        if not mine and of > len(parts):
            warnings.warn(
                f"{of} loader workers for {len(parts)} parts: the others have nothing to do; use "
                "fewer, or index the dataset in smaller parts (part_size)",
                stacklevel=2,
            )
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


def _bools(keep: Sequence[bool] | np.ndarray, count: int) -> np.ndarray:
    found = np.asarray(keep)
    if len(found) != count:
        raise UsageError(f"stream: keep: expected {count} values, found {len(found)}")
    if found.dtype != bool:
        raise UsageError(f"stream: keep: expected bool, found {found.dtype}")
    return found
