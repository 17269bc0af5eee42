"""Training and validation examples of a run: whole in memory, or window by window."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import torch

from ...common.errors import RsaDataError
from ...store.tables import WorkDir
from .. import redescribed
from ..inputs.objects import Objects
from ..inputs.vectors import Vectors
from ..predict.calibration import names, references
from .control_heads import controlled
from .examples import Examples, join, read_part, select
from .plan import Plan
from .validation_split import by_scene

_GIB = 2**30
Part = tuple[int, int]  # number of the dataset, number of the part
_SEEN = 512  # features of a part kept to choose references from


class Windows:
    """The examples of every training part, and what one pass over them tells.

    validation : the examples held out, each with its plain caption only; always in memory.
    total : training images in an epoch. dim : length of a feature.
    mean, factor : float32 (dim,): standardised features are (features - mean) * factor.
    images, validation_images, left_out, mean_depth : arrays with a number for each dataset.
        left_out images were not ok in every table; mean_depth is in m.
    how : how validation was chosen, a text for each dataset.
    inputs : of the validation examples: widths, and room for objects.
    reference : float16 (m, dim), some of the training features, raw, or the names of a head that
        reads objects alone; None for a head that reads more.
    typical : scale and shift to begin with: the median of the images' own positive fits, geometric
        mean over the datasets; 1 where there are none.
    """

    def __init__(self, work: WorkDir, plan: Plan):
        self.work, self.plan = work, plan
        self.count = len(plan.sources)
        self.parts = [plan.parts[source.dataset] for source in plan.sources]
        # A window, the parts that it is joined from, and the one before that is not let go of yet.
        self.limit = plan.machine.memory * _GIB / 3
        self._choose()
        self._scan()
        self._describe: list[redescribed.Inputs] = []
        if plan.training.redraw:
            weights = plan.machine.encoder_weights
            self._describe = [redescribed.inputs(work, s, weights) for s in plan.sources]

    def __call__(self, epoch: int) -> Iterator[Examples]:
        """The training examples of an epoch: one window, or several in an order drawn for it."""
        if self.whole is not None and not self._describe:
            yield self.whole
            return
        parts = list(self.sizes)
        order = np.random.default_rng((self.plan.training.seed, epoch)).permutation(len(parts))
        parts = [parts[i] for i in order]
        cut = self._of_each if self.plan.training.batches == "each" else self._in_turn
        for window in cut(parts):
            yield self._read(window, epoch)

    def _in_turn(self, parts: list[Part]) -> Iterator[list[Part]]:
        """Windows of one part after another, as many as fit."""
        window: list[Part] = []
        for part in parts:
            if window and sum(self.sizes[p] for p in window) + self.sizes[part] > self.limit:
                yield window
                window = []
            window.append(part)
        yield window

    def _of_each(self, parts: list[Part]) -> Iterator[list[Part]]:
        """Windows that hold a like share of the parts of every dataset."""
        count = -(-sum(self.sizes.values()) // int(self.limit))
        own = [[part for part in parts if part[0] == i] for i in range(self.count)]
        if (fewest := min(map(len, own))) < count:
            needed = 3 * sum(self.sizes.values()) / fewest / _GIB
            raise RsaDataError(
                f"train-head: --batches each: expected parts of every dataset in memory at once; "
                f"--memory {self.plan.machine.memory:g} is too little. Give --memory "
                f"{max(1, round(needed + 0.5))}, or index into smaller parts"
            )
        for number in range(count):
            yield [part for of in own for part in of[number::count]]

    def _read(self, window: list[Part], epoch: int) -> Examples:
        return join([self._split(i, n, epoch)[0] for i, n in window], self.pixels)

    def _choose(self) -> None:
        """Decides for every row of samples whether it is held out, dataset by dataset."""
        self.held: dict[Part, np.ndarray] = {}
        self.how: list[str] = []
        how = self.plan.training
        for i, (source, parts) in enumerate(zip(self.plan.sources, self.parts, strict=True)):
            samples = self.work.table(source.dataset, "samples")
            scenes = [
                samples.read(n, ["scene"])["scene"].to_numpy().astype(object) for n in parts.numbers
            ]
            if parts.validation:
                chosen = [np.full(len(s), n in parts.validation)
                          for s, n in zip(scenes, parts.numbers, strict=True)]  # fmt: skip
                self.how.append(f"the split {parts.split}")
            else:
                held, told = by_scene(
                    source.dataset, np.concatenate(scenes), how.validation, how.split_scene
                )
                self.how.append(told)
                chosen = np.split(held, np.cumsum([len(scene) for scene in scenes])[:-1])
            for n, rows in zip(parts.numbers, chosen, strict=True):
                self.held[i, n] = rows

    def _split(
        self, dataset: int, number: int, epoch: int | None = None
    ) -> tuple[Examples, Examples]:
        """Training and validation examples of one part; epoch : to draw descriptions for."""
        part = read_part(self.work, self.plan.sources[dataset], number, dataset)
        control, seed = self.plan.model.control, self.plan.training.seed
        if epoch is not None and self._describe:
            drawn = {"seed": int(np.random.SeedSequence((seed, epoch)).generate_state(1)[0])}
            blocks = self._describe[dataset].read(self.work, number, drawn, variant=1)
            part = replace(part, inputs=tuple(block.take(part.row) for block in blocks))
        part = controlled(part, control, seed, number, self.count)
        held = self.held[dataset, number][part.row]
        return select(part, ~held), select(part, held, variants=1)

    def _scan(self) -> None:
        """One pass: statistics, the validation examples, and the training ones while they fit."""
        count = self.count
        self.left_out, self.images = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self.sizes: dict[Part, int] = {}
        depth_sum = np.zeros(count)
        fits: list[list[np.ndarray]] = [[] for _ in range(count)]
        validation: list[Examples] = []
        kept: list[Examples] = []
        moments: list[Moments] = []
        seen: list[np.ndarray] = []
        named: list[np.ndarray] = []
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
            moments = moments or [Moments(block.width) for block in train.inputs]
            for moment, block in zip(moments, train.inputs, strict=True):
                moment.add(block.distinct())
            if len(train.inputs) == 1 and isinstance(train.inputs[0], Vectors):
                features = train.inputs[0].features
                seen.append(features[:: -(-len(features) // _SEEN)])
            elif len(train.inputs) == 1 and isinstance(train.inputs[0], Objects):
                named.append(train.inputs[0].named())
            kept = [*kept, train] if sum(self.sizes.values()) <= self.limit else []
        self._check(validation)
        self.validation = join(validation)
        self.validation_images = np.bincount(self.validation.dataset, minlength=count)
        self.total, self.mean_depth = int(self.images.sum()), depth_sum / self.images
        self.pixels = self.validation.relative.shape[1]
        self.whole = join(kept, self.pixels) if len(kept) == len(self.sizes) else None
        self.reference = references(seen) if seen else names(named) if named else None
        self.typical = _typical([np.concatenate(f) for f in fits])
        self.inputs = self.validation.inputs
        pairs = [moment.standard() for moment in moments]
        self.mean, self.factor = (torch.cat(column) for column in zip(*pairs, strict=True))
        self.dim = len(self.mean)
        if not self.plan.model.standardize:
            self.mean, self.factor = torch.zeros(self.dim), torch.ones(self.dim)

    def _check(self, validation: list[Examples]) -> None:
        for i, source in enumerate(self.plan.sources):
            if not self.images[i] or not any((e.dataset == i).any() for e in validation):
                inputs = ", ".join(feed.captions or feed.table for feed in source.inputs)
                raise RsaDataError(
                    f"{source.dataset}: expected training and validation images that are ok in "
                    f"{inputs} and {source.depth}; found {self.images[i]} for "
                    f"training, {self.left_out[i]} left out. `rsa-data status` shows what failed"
                )
            known = [e.share[e.dataset == i] for e in validation]
            if self.plan.goal.balance == "pixels" and not np.isfinite(np.concatenate(known)).all():
                raise RsaDataError(
                    f"{source.dataset}/{source.depth}: --balance pixels: expected the size of each "
                    "image beside its number of valid pixels; found none. Run its stage again"
                )


class Moments:
    """Mean of each feature of an input and one spread for all of them, over batches of rows.

    width : numbers in a row of the input; those behind the ones counted stay as they are.
    """

    def __init__(self, width: int) -> None:
        self.width = width
        self.count, self.sum, self.squares = 0, np.zeros(1), np.zeros(1)

    def add(self, features: np.ndarray) -> None:
        """Counts features of shape (n, at most width)."""
        for rows in np.array_split(features, max(1, -(-len(features) // 4096))):
            rows = rows.astype(np.float64)
            self.count += len(rows)
            self.sum = self.sum + rows.sum(0)
            self.squares = self.squares + np.square(rows).sum(0)

    def standard(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and 1 / spread, each float32 (width,).

        One factor for all of an input keeps the angles between features, where one for each would
        blow up those that hardly vary in a small training set.
        """
        mean, factor = np.zeros(self.width), np.ones(self.width)
        if self.count:
            found = self.sum / self.count
            variance = self.squares / self.count - found**2
            mean[: len(found)] = found
            factor[: len(found)] = 1 / max(float(variance.mean()), 1e-12) ** 0.5
        return torch.from_numpy(mean).float(), torch.from_numpy(factor).float()


def _typical(fits: list[np.ndarray]) -> tuple[float, float]:
    """Geometric mean over datasets of the median positive scale and shift of (n, 2) fits."""
    found = []
    for column in (0, 1):
        medians = [np.median(f[f[:, column] > 0, column]) for f in fits if (f[:, column] > 0).any()]
        found.append(float(np.exp(np.mean(np.log(medians)))) if medians else 1.0)
    return found[0], found[1]
