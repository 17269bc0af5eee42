"""The optimisation itself: epochs over examples, best weights by validation, state that resumes."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from torch import nn
from torch.optim.adam import adam
from torch.optim.adamw import adamw

from ...common.errors import RsaDataError
from ..architectures.layers import Head
from .batches import Batch, batches
from .examples import Examples
from .losses import Loss, depth, over_each, over_images, raw, to_fit
from .plan import Goal, Training
from .state import State


@dataclass(frozen=True)
class Settings:
    """What the optimisation needs beside the options.

    loss : of depth. batch : images in a step. epoch : images that an epoch shows.
    log : bool for each dataset: its loss in a batch enters as its logarithm.
    weight, unit, min_depth, max_depth : a number for each dataset: what multiplies the loss of its
        images; what its metric errors are divided by, m; the range of its depth, m.
    """

    goal: Goal
    training: Training
    loss: Loss
    batch: int
    epoch: int
    log: np.ndarray
    weight: np.ndarray
    unit: np.ndarray
    min_depth: np.ndarray
    max_depth: np.ndarray


def flatten(network: nn.Module) -> torch.Tensor:
    """Moves all parameters, and their gradients, into one row each, of which they become views.

    One row makes one kernel of Adam and one norm of the gradient, instead of one a layer.
    """
    parameters = list(network.parameters())
    row = torch.cat([p.detach().reshape(-1) for p in parameters])
    row.grad = torch.zeros_like(row)
    start = 0
    for p in parameters:
        end = start + p.numel()
        p.data = row[start:end].view_as(p)
        p.grad = row.grad[start:end].view_as(p)
        start = end
    return row


def begin(network: nn.Module) -> State:
    """The state before the first epoch."""
    row = torch.cat([p.detach().reshape(-1) for p in network.parameters()])
    zeros = torch.zeros_like(row)
    return State(row.clone(), zeros.clone(), zeros.clone(), row.clone())


class Data(Protocol):
    """What a run learns from; `windows.Windows` documents each."""

    total: int
    validation: Examples
    mean: torch.Tensor
    factor: torch.Tensor

    def __call__(self, epoch: int) -> Iterable[Examples]:
        """The training examples in as many windows as memory asks for, the same for an epoch."""


def fit(
    network: Head,
    data: Data,
    settings: Settings,
    state: State,
    after_epoch: Callable[[State], None],
    tick: Callable[[int], Any],
) -> State:
    """Trains `network` from `state` to the last epoch, or until validation stops improving.

    after_epoch : called with the state after each epoch, to store it. tick : called with the number
    of images after each step.
    """
    how = settings.training
    row = flatten(network)
    with torch.no_grad():
        row.copy_(state.weights)
    optimizer = _Adam(row, how, state)
    for epoch in range(len(state.history), how.epochs):
        if how.patience and epoch - state.best_epoch >= how.patience:
            break
        seen, loss, lr = 0, 0.0, how.lr
        network.train()
        for number, window in enumerate(data(epoch)):
            seed = _mix(how.seed, epoch, number)
            generator = torch.Generator().manual_seed(seed)
            with torch.random.fork_rng(devices=[]):
                torch.manual_seed(seed)  # what a head itself draws in training
                drawn = batches(
                    window,
                    data,
                    network,
                    size=settings.batch,
                    pixels=how.pixels,
                    how=how.batches,
                    generator=generator,
                )
                for batch in drawn:
                    # Progress counts images, so that it does not depend on how windows are cut.
                    lr = how.learning_rate(epoch + seen / settings.epoch)
                    loss += _step(network, row, batch, settings) * len(batch)
                    optimizer.step(lr)
                    seen += len(batch)
                    state.steps += 1
                    tick(len(batch))
        network.eval()
        # The last step's weights enter no loss of this epoch.
        if not (np.isfinite(loss) and torch.isfinite(row).all()):
            raise RsaDataError(
                f"train-head: the loss is not finite any more in epoch {epoch + 1}: expected it to "
                "fall. Lower --lr, or leave --clip and --initial as they are"
            )
        state.weights = row.detach().clone()
        state.moment1, state.moment2 = optimizer.moment1.clone(), optimizer.moment2.clone()
        errors = abs_rel(network, data, settings)
        state.history.append(
            {"epoch": epoch + 1, "lr": lr, "train_loss": loss / seen, "errors": errors}
            | {"val_abs_rel": float(np.mean(list(errors.values())))}
        )
        if state.best_epoch == epoch + 1:
            state.best = state.weights
        after_epoch(state)
    return state


class _Adam:
    """Adam or AdamW on one row of parameters, by the functions behind torch.optim's classes.

    Making an object of these classes imports torch._dynamo: 1.3 s of CPU time in every process.
    """

    def __init__(self, row: torch.Tensor, how: Training, state: State):
        self.row, self.weight_decay = row, how.weight_decay
        self.update = adamw if how.optimizer == "adamw" else adam
        self.steps = torch.tensor(float(state.steps))
        self.moment1, self.moment2 = state.moment1.clone(), state.moment2.clone()

    def step(self, lr: float) -> None:
        """Moves the row against its gradient."""
        assert self.row.grad is not None
        self.update(
            [self.row],
            [self.row.grad],
            [self.moment1],
            [self.moment2],
            [],
            [self.steps],
            fused=True,
            amsgrad=False,
            beta1=0.9,
            beta2=0.999,
            lr=lr,
            weight_decay=self.weight_decay,
            eps=1e-8,
            maximize=False,
        )


def _mix(*numbers: int) -> int:
    """One seed of several numbers, by numpy's SeedSequence."""
    return int(np.random.SeedSequence(numbers).generate_state(1, np.uint64)[0] >> 1)


def _step(
    network: Head,
    row: torch.Tensor,
    batch: Batch,
    settings: Settings,
) -> float:
    """The gradient of a batch's loss, clipped, in `row.grad`; returns the loss."""
    how = settings.training
    with torch.autocast("cpu", torch.bfloat16, enabled=how.precision == "bfloat16"):
        scale, shift = network(batch.x)  # (b,), (b,)
    loss = _of_images(scale, shift, batch, settings)  # (b,)
    over = over_each if how.batches == "each" else over_images
    whole = over(loss, batch.dataset, settings.log)
    gradient = row.grad
    assert gradient is not None
    gradient.zero_()
    torch.autograd.backward(whole)
    norm = gradient.norm()
    if how.clip and norm > how.clip:
        gradient.mul_(how.clip / norm)
    return float(whole.detach())


def _of_images(
    scale: torch.Tensor, shift: torch.Tensor, batch: Batch, settings: Settings
) -> torch.Tensor:
    """The weighted loss of each image of a batch, (b,)."""
    goal, dataset = settings.goal, batch.dataset
    loss = torch.zeros(len(batch))
    if goal.supervision != "fit":
        inverse = scale[:, None] * batch.y + shift[:, None]  # (b, k)
        far = torch.from_numpy(settings.max_depth)[dataset, None].float()
        predicted = raw(inverse) if goal.beyond == "raw" else depth(inverse, far)
        unit = torch.from_numpy(settings.unit)[dataset].float() if settings.loss.in_metres else 1.0
        loss = loss + settings.loss.of(predicted, batch.true) / unit
    if goal.supervision != "depth":
        loss = loss + to_fit(scale, shift, batch.fit)
    if goal.balance == "pixels":
        loss = loss * batch.share
    return loss * torch.from_numpy(settings.weight)[dataset].float()


@torch.no_grad()
def abs_rel(network: Head, data: Data, settings: Settings) -> dict[int, float]:
    """AbsRel of each dataset: mean over its images of |predicted - true| / true at their pixels.

    Each image with its first variant; predictions are clipped to the dataset's depth range.
    """
    examples = data.validation
    errors = []
    for begin in range(0, len(examples), 1024):
        images = np.arange(begin, min(begin + 1024, len(examples)))
        x = torch.from_numpy(examples.rows(images)).float()
        scale, shift = network(network.centred(x, data.mean, data.factor))
        y, true = (
            torch.from_numpy(a[images]).float() for a in (examples.relative, examples.metric)
        )
        dataset = examples.dataset[images]
        near, far = (
            torch.from_numpy(limit[dataset])[:, None].float()
            for limit in (settings.min_depth, settings.max_depth)
        )
        inverse = scale[:, None] * y + shift[:, None]
        predicted = torch.where(inverse > 0, 1 / inverse, torch.inf).maximum(near).minimum(far)
        errors.append(((predicted - true).abs() / true).mean(1))  # (b,)
    error = torch.cat(errors).numpy()
    present = np.unique(examples.dataset)
    return {int(d): float(error[examples.dataset == d].mean()) for d in present}
