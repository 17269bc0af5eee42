"""What is to be trained, and how: the options of train-head in groups, and the plan they make."""

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from ... import registry
from ...common.ranges import Amount, AtOnce, Count, Positive, PositiveAmount
from ..belong import Source, Tables
from ..description import DepthModel, Features

Batches = Literal["mixed", "each"]

# Options that never change what comes out.
_LOCAL = ("memory", "checkpoint_every", "encoder_weights")
# Options that came later are told only where they are not these, so that a training that was
# begun before them is still the same one.
_LATER = {"beyond": "tangent", "batches": "mixed", "redraw": False}


@dataclass(frozen=True)
class Model:
    """Which network, and what it may see.

    head : architecture; see `rsa-data list heads`.
    control : train a control instead: each image with the captions of another image of its dataset
        (shuffled), or with no more than its dataset's name (dataset).
    initial : begin with outputs at the datasets' typical scale and shift, or with random ones as
        the released code.
    standardize : centre the features and divide them by one number, their spread over the training
        set; part of the head. Without it the raw features go in, as in the released code.
    """

    head: str = "mlp5"
    control: Literal["none", "shuffled", "dataset"] = "none"
    initial: Literal["typical", "random"] = "typical"
    standardize: bool = True


@dataclass(frozen=True)
class Goal:
    """What is minimised.

    loss : what is minimised at the sampled pixels, one of `rsa-data list losses`.
    supervision : learn from depth, from each image's own least-squares fit, or from both. Of a fit
        only what is positive counts, as a head's scale and shift are.
    units : relative divides a loss in metres by the dataset's mean depth, so that streets do not
        outweigh rooms; metres leaves it as it is.
    balance : datasets lets each dataset weigh the same, images each image, pixels each image by the
        share of its pixels that are valid, as the released code does.
    log_loss : datasets whose loss in a batch enters as its logarithm, so that its size does not
        matter. The released code does so, for NYUv2 and VOID but not for KITTI, by a slip.
    beyond : depth past the dataset's maximum continues along a tangent, so that loss and gradient
        stay finite, or it is 1 / (scale * y + shift) itself (raw), as in the released code.
    """

    loss: str = "l1"
    supervision: Literal["depth", "fit", "both"] = "depth"
    units: Literal["relative", "metres"] = "relative"
    balance: Literal["datasets", "images", "pixels"] = "datasets"
    log_loss: tuple[str, ...] = ()
    beyond: Literal["tangent", "raw"] = "tangent"


@dataclass(frozen=True)
class Training:
    """How it is optimised, and by what the best epoch is chosen.

    optimizer : Adam, or AdamW.
    schedule : how the learning rate falls from lr to end-lr, cosine or polynomial (power 0.9).
    lr : learning rate at its highest.
    end_lr : learning rate at the end.
    warmup : epochs over which the learning rate rises from nothing.
    weight_decay : of the optimiser.
    clip : norm that gradients are clipped to; 0 for none.
    epochs : times that every image is seen, each time with a variant of its caption drawn again.
    redraw : draw swap and delete anew for every epoch, from the segments, in place of the variants
        that stand in the tables. Every epoch encodes a text an image; for a head that reads only
        objects it costs next to nothing.
    batch : images in a step; by default a sixteenth of all, but 16 to 256.
    batches : mixed draws the images of a step from all datasets together and takes the mean of
        their losses; each takes a batch of every dataset and adds their losses, each summed over
        its images, as the released code does. An epoch of it ends with the smallest dataset.
    pixels : pixels of each image in a step, of those that the depth table holds; 0 for all.
    validation : share of the training images held out to choose the best epoch, whole scenes;
        where a dataset has a validation split, that split is taken instead.
    split_scene : where a dataset has one scene only, hold out its last frames instead of refusing.
    patience : stop after so many epochs without a better validation error; 0 runs them all.
    precision : of the matrix products; auto takes bfloat16 where the processor has it in hardware,
        which is about twice as fast and ends at the same error.
    seed : of the first weights and of everything that is drawn.
    """

    optimizer: Literal["adam", "adamw"] = "adam"
    schedule: Literal["cosine", "polynomial"] = "cosine"
    lr: PositiveAmount = 1e-3
    end_lr: Amount = 3e-5
    warmup: Amount = 1.0
    weight_decay: Amount = 0.0
    clip: Amount = 1.0
    epochs: Positive = 50
    redraw: bool = False
    batch: Positive | None = None
    batches: Batches = "mixed"
    pixels: Count = 256
    validation: Annotated[float, msgspec.Meta(gt=0, le=0.5)] = 0.1
    split_scene: bool = False
    patience: Count = 0
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    seed: Count = 0

    def learning_rate(self, epoch: float) -> float:
        """The rate after so many epochs, a fraction included: warm-up, then its schedule."""
        done = min(epoch / self.epochs, 1.0)
        if self.schedule == "cosine":
            left = 0.5 * (1 + math.cos(math.pi * done))
        else:  # power 0.9, as in the released code
            left = (1 - done) ** 0.9
        rate = self.end_lr + (self.lr - self.end_lr) * left
        return rate * min(1.0, (epoch + 1e-2) / self.warmup) if self.warmup else rate


@dataclass(frozen=True)
class Machine:
    """What a training may take of the machine.

    memory : GiB of examples held at once; larger tables are read in windows of parts every epoch.
    checkpoint_every : seconds of work that a kill may lose; at the end of an epoch the state is
        written when the last time is that long ago.
    threads : CPU threads; they can change the last bits of the weights.
    encoder_weights : file of the text encoder's weights for redraw, where it is not found alone.
    """

    memory: PositiveAmount = 4.0
    checkpoint_every: Amount = 20.0
    threads: AtOnce = 2
    encoder_weights: Path | None = None


class Described(msgspec.Struct, kw_only=True, frozen=True):
    """What another training must share to be the same one: the description of a head's folder.

    options : of train-head. inputs : digest of the parts trained on, by dataset and table.
    code : sha256 of the module of each head, loss and input that is not this package's.
    """

    stage: str = "train-head"
    schema: str = "history"
    version: int = 2
    options: dict[str, Any]
    inputs: dict[str, dict[str, str]]
    code: dict[str, str] | msgspec.UnsetType = msgspec.UNSET


@dataclass(frozen=True)
class Parts:
    """The parts of a dataset that a training reads.

    train, validation : part numbers; without the latter, scenes of the former are held out.
    split : name of the validation split, or nothing.
    """

    train: list[int]
    validation: list[int]
    split: str = ""

    @property
    def numbers(self) -> list[int]:
        """All of them, ascending."""
        return sorted([*self.train, *self.validation])


@dataclass(frozen=True)
class Plan:
    """All that decides the head, checked: see `train_head`.

    parts, limits, digests : by dataset: parts to read; (min, max) depth, m; digest of those parts
        of each table.
    """

    name: str
    sources: list[Source]
    parts: dict[str, Parts]
    limits: dict[str, tuple[float, float]]
    digests: dict[str, dict[str, str]]
    features: Features
    depth_model: DepthModel
    tables: Tables
    model: Model
    goal: Goal
    training: Training
    machine: Machine

    @property
    def options(self) -> dict[str, Any]:
        """The options of train-head that can change the head."""
        groups = (self.tables, self.model, self.goal, self.training, self.machine)
        found = {k: v for group in groups for k, v in dataclasses.asdict(group).items()}
        lists = {k: list(v) for k, v in found.items() if isinstance(v, tuple)}
        told = {k: v for k, v in {**found, **lists}.items() if k not in _LOCAL}
        return {k: v for k, v in told.items() if _LATER.get(k) != v}

    @property
    def described(self) -> Described:
        """What another run must share to be the same run."""
        reads = (feed.kind for source in self.sources for feed in source.inputs)
        names = [(registry.HEADS, self.model.head), (registry.LOSSES, self.goal.loss)]
        names += [(registry.INPUTS, kind) for kind in reads]
        found = [source for entries, name in names if (source := entries.source(name))]
        # Since version 3 a head that reads objects alone holds their names.
        objects = all(f.kind == "objects" for source in self.sources for f in source.inputs)
        code = {source["code"]: source["code_sha256"] for source in found}
        return Described(
            version=3 if objects else 2,
            options=self.options,
            inputs=self.digests,
            code=code if code else msgspec.UNSET,
        )
