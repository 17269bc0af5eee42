"""Training and validation examples of a run: whole in memory, or window by window."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch

from ...common.errors import RsaDataError
from ...store.tables import WorkDir
from ..predict.calibration import references
from .controls import controlled
from .examples import Examples, join, read_part, select
from .validation_split import by_scene

if TYPE_CHECKING:
    from .training_run import Plan

_GIB = 2**30
_SEEN = 512  # features of a part kept to choose references from


class Windows:
    """The examples of every training part, and what one pass over them tells.

    validation : the examples held out, each with its plain caption only; always in memory.
    total : training images in an epoch. dim : length of a feature.
    mean, factor : float32 (dim,): standardised features are (features - mean) * factor.
    images, validation_images, left_out, mean_depth : arrays with a number for each dataset.
        left_out images were not ok in every table; mean_depth is in m.
    how : how validation was chosen, a text for each dataset.
    reference : float16 (m, dim), some of the training features, raw.
    typical : scale and shift to begin with: the median of the images' own positive fits, geometric
        mean over the datasets; 1 where there are none.
    """

    def __init__(self, work: WorkDir, plan: "Plan"):
        self.work, self.plan = work, plan
        self.numbers = [plan.numbers[source.dataset] for source in plan.sources]
        # A window, the parts that it is joined from, and the one before that is not let go of yet.
        self.limit = plan.options["memory"] * _GIB / 3
        self._choose()
        self._scan()

    def __call__(self, epoch: int) -> Iterator[Examples]:
        """The training examples of an epoch: one window, or several in an order drawn for it."""
        if self.whole is not None:
            yield self.whole
            return
        parts = list(self.sizes)
        order = np.random.default_rng((self.plan.options["seed"], epoch)).permutation(len(parts))
        window: list[tuple[int, int]] = []
        for part in [parts[i] for i in order]:
            if window and sum(self.sizes[p] for p in window) + self.sizes[part] > self.limit:
                yield self._read(window)
                window = []
            window.append(part)
        yield self._read(window)

    def _read(self, window: list[tuple[int, int]]) -> Examples:
        return join([self._split(i, n)[0] for i, n in window], self.pixels)

    def _choose(self) -> None:
        """Decides for every row of samples whether it is held out, dataset by dataset."""
        self.held: dict[tuple[int, int], np.ndarray] = {}
        self.how: list[str] = []
        options = self.plan.options
        for i, source in enumerate(self.plan.sources):
            samples = self.work.table(source.dataset, "samples")
            scenes = [
                samples.read(n, ["scene"])["scene"].to_numpy().astype(object)
                for n in self.numbers[i]
            ]
            held, how = by_scene(
                source.dataset,
                np.concatenate(scenes),
                options["validation"],
                options["split_scene"],
            )
            self.how.append(how)
            ends = np.cumsum([len(scene) for scene in scenes])[:-1]
            for n, rows in zip(self.numbers[i], np.split(held, ends), strict=True):
                self.held[i, n] = rows

    def _split(self, dataset: int, number: int) -> tuple[Examples, Examples]:
        """Training and validation examples of one part."""
        part = read_part(self.work, self.plan.sources[dataset], number, dataset)
        options, count = self.plan.options, len(self.plan.sources)
        part = controlled(part, options["control"], options["seed"], number, count)
        held = self.held[dataset, number][part.row]
        return select(part, ~held), select(part, held, variants=1)

    def _scan(self) -> None:
        """One pass: statistics, the validation examples, and the training ones while they fit."""
        count = len(self.plan.sources)
        self.left_out, self.images = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self.sizes: dict[tuple[int, int], int] = {}
        depth_sum, fits = np.zeros(count), [[] for _ in range(count)]  # type: ignore[var-annotated]
        validation: list[Examples] = []
        kept: list[Examples] = []
        moments = Moments(self.plan.widths)
        seen: list[np.ndarray] = []
        for i, n in self.held:
            train, held = self._split(i, n)
            self.left_out[i] += len(self.held[i, n]) - len(train) - len(held)
            if len(held):
                validation.append(held)
            if not len(train):
                continue
            self.images[i] += len(train)
            self.sizes[i, n] = train.nbytes
            depth_sum[i] += train.metric.mean(1, dtype=np.float64).sum()
            fits[i].append(train.fit)
            moments.add(train.features)
            seen.append(train.features[:: -(-len(train.features) // _SEEN)])
            kept = [*kept, train] if sum(self.sizes.values()) <= self.limit else []
        self._check(validation)
        self.validation = join(validation)
        self.validation_images = np.bincount(self.validation.dataset, minlength=count)
        self.total, self.mean_depth = int(self.images.sum()), depth_sum / self.images
        self.pixels = self.validation.relative.shape[1]
        self.whole = join(kept, self.pixels) if len(kept) == len(self.sizes) else None
        self.reference = references(seen)
        self.typical = _typical([np.concatenate(f) for f in fits])
        self.dim = self.validation.features.shape[1]
        self.mean, self.factor = moments.standard()
        if not self.plan.options["standardize"]:
            self.mean, self.factor = torch.zeros(self.dim), torch.ones(self.dim)

    def _check(self, validation: list[Examples]) -> None:
        for i, source in enumerate(self.plan.sources):
            if not self.images[i] or not any((e.dataset == i).any() for e in validation):
                raise RsaDataError(
                    f"{source.dataset}: expected training and validation images with a caption in "
                    f"{source.captions} and depth in {source.depth}; found {self.images[i]} for "
                    f"training, {self.left_out[i]} left out. `rsa-data status` shows what failed"
                )


class Moments:
    """Mean of each feature, and one spread for all of a table, over batches of features.

    widths : how many features come from each table; they stand side by side.
    """

    def __init__(self, widths: Sequence[int]) -> None:
        self.widths = widths
        self.count, self.sum, self.squares = 0, np.zeros(1), np.zeros(1)

    def add(self, features: np.ndarray) -> None:
        """Counts features of shape (n, dim)."""
        for rows in np.array_split(features, -(-len(features) // 4096)):
            rows = rows.astype(np.float64)
            self.count += len(rows)
            self.sum = self.sum + rows.sum(0)
            self.squares = self.squares + np.square(rows).sum(0)

    def standard(self) -> tuple[torch.Tensor, torch.Tensor]:
        """mean (dim,), and 1 / spread of each table, repeated to (dim,).

        One factor for all of a table keeps the angles between features, where one for each would
        blow up those that hardly vary in a small training set.
        """
        mean = self.sum / self.count
        variance = np.split(self.squares / self.count - mean**2, np.cumsum(self.widths)[:-1])
        spread = [np.full(len(v), max(float(v.mean()), 1e-12) ** 0.5) for v in variance]
        return torch.from_numpy(mean).float(), torch.from_numpy(1 / np.concatenate(spread)).float()


def _typical(fits: list[np.ndarray]) -> tuple[float, float]:
    """Geometric mean over datasets of the median positive scale and shift of (n, 2) fits."""
    found = []
    for column in (0, 1):
        medians = [np.median(f[f[:, column] > 0, column]) for f in fits if (f[:, column] > 0).any()]
        found.append(float(np.exp(np.mean(np.log(medians)))) if medians else 1.0)
    return found[0], found[1]
