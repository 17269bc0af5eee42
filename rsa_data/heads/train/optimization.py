"""The optimisation itself: epochs over examples, best weights by validation, state that resumes."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import torch
from torch import nn

from ...common.errors import RsaDataError
from .examples import Examples
from .losses import LOSSES, METRIC, depth, to_fit
from .settings import Settings, learning_rate


@dataclass
class State:
    """What a run has come to after some epochs; enough to go on as if nothing had happened.

    weights, moment1, moment2 : all parameters in one row, and Adam's moments; best : the weights
    of the best epoch; history : one dict an epoch.
    """

    weights: torch.Tensor
    moment1: torch.Tensor
    moment2: torch.Tensor
    best: torch.Tensor
    steps: int = 0
    history: list[dict[str, Any]] = field(default_factory=list)

    @property
    def best_epoch(self) -> int:
        """Epoch with the lowest validation AbsRel, the earliest if several; 0 before the first."""
        errors = [row["val_abs_rel"] for row in self.history]
        return 1 + int(np.argmin(errors)) if errors else 0


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
    network: nn.Module,
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
    row = flatten(network)
    with torch.no_grad():
        row.copy_(state.weights)
    kind = torch.optim.AdamW if settings.optimizer == "adamw" else torch.optim.Adam
    decay = settings.weight_decay
    optimizer = kind([row], lr=settings.lr, weight_decay=decay, fused=True)
    optimizer.state[row] = {
        "step": torch.tensor(float(state.steps)),
        "exp_avg": state.moment1.clone(),
        "exp_avg_sq": state.moment2.clone(),
    }
    for epoch in range(len(state.history), settings.epochs):
        if settings.patience and epoch - state.best_epoch >= settings.patience:
            break
        seen, loss = 0, 0.0
        for number, window in enumerate(data(epoch)):
            generator = torch.Generator().manual_seed(_mix(settings.seed, epoch, number))
            for batch in _batches(window, data, settings, generator):
                # Progress counts images, so that it does not depend on how windows are cut.
                lr = learning_rate(settings, epoch + seen / data.total)
                optimizer.param_groups[0]["lr"] = lr
                loss += _step(network, row, optimizer, batch, settings) * len(batch[0])
                seen += len(batch[0])
                state.steps += 1
                tick(len(batch[0]))
        if not np.isfinite(loss):
            raise RsaDataError(
                f"train-head: the loss is not finite any more in epoch {epoch + 1}: expected it to "
                "fall. Lower --lr, or leave --clip and --initial as they are"
            )
        slot = optimizer.state[row]
        state.weights = row.detach().clone()
        state.moment1, state.moment2 = slot["exp_avg"].clone(), slot["exp_avg_sq"].clone()
        errors = abs_rel(network, data, settings)
        state.history.append(
            {"epoch": epoch + 1, "lr": lr, "train_loss": loss / seen, "errors": errors}
            | {"val_abs_rel": float(np.mean(list(errors.values())))}
        )
        if state.best_epoch == epoch + 1:
            state.best = state.weights
        after_epoch(state)
    return state


def _mix(*numbers: int) -> int:
    """One seed of several numbers, by numpy's SeedSequence."""
    return int(np.random.SeedSequence(numbers).generate_state(1, np.uint64)[0] >> 1)


def _batches(
    window: Examples, data: Data, settings: Settings, generator: torch.Generator
) -> Iterable[tuple[torch.Tensor, ...]]:
    """Batches of one epoch over one window: features, y and metric depth, fit, dataset.

    Every image comes once, with a caption variant and a run of its pixels drawn for this epoch.
    """
    features, texts = torch.from_numpy(window.features), torch.from_numpy(window.texts)
    first = torch.from_numpy(window.first)
    relative, metric = torch.from_numpy(window.relative), torch.from_numpy(window.metric)
    fits, dataset = torch.from_numpy(window.fit), torch.from_numpy(window.dataset)
    order = torch.randperm(len(window), generator=generator)
    drawn = torch.rand(len(window), generator=generator, dtype=torch.float64)
    variant = first[:-1] + (drawn * first.diff()).long()
    for rows in order.split(settings.batch):
        # Pixels are stored in random order, so any run of them is a random sample.
        runs = max(1, relative.shape[1] // settings.pixels)
        start = settings.pixels * int(torch.randint(runs, (1,), generator=generator))
        pixels = slice(start, start + settings.pixels)
        yield (
            (features[texts[variant[rows]]].float() - data.mean) * data.factor,
            relative[rows, pixels].float(),
            metric[rows, pixels].float(),
            fits[rows],
            dataset[rows],
        )


def _step(
    network: nn.Module,
    row: torch.Tensor,
    optimizer: torch.optim.Optimizer,
    batch: tuple[torch.Tensor, ...],
    settings: Settings,
) -> float:
    """One step of the optimiser; returns the loss."""
    x, y, true, fits, dataset = batch
    with torch.autocast("cpu", torch.bfloat16, enabled=settings.precision == "bfloat16"):
        scale, shift = network(x)  # (b,), (b,)
    loss = torch.zeros(len(x))
    if settings.supervision != "fit":
        far = torch.from_numpy(settings.max_depth)[dataset, None].float()
        predicted = depth(scale[:, None] * y + shift[:, None], far)  # (b, k)
        unit = torch.from_numpy(settings.unit)[dataset].float() if settings.loss in METRIC else 1.0
        loss = loss + LOSSES[settings.loss](predicted, true) / unit  # (b,)
    if settings.supervision != "depth":
        loss = loss + to_fit(scale, shift, fits)
    loss = loss * torch.from_numpy(settings.weight)[dataset].float()
    mean = loss.mean() if not settings.log.any() else with_logs(loss, dataset, settings.log)
    gradient = row.grad
    assert gradient is not None
    gradient.zero_()
    mean.backward()
    norm = gradient.norm()
    if settings.clip and norm > settings.clip:
        gradient.mul_(settings.clip / norm)
    optimizer.step()
    return float(mean.detach())


def with_logs(loss: torch.Tensor, dataset: torch.Tensor, log: np.ndarray) -> torch.Tensor:
    """Sum over the datasets of a batch of their mean loss, or of its logarithm."""
    total = torch.zeros(())
    for d in dataset.unique().tolist():
        mean = loss[dataset == d].mean()
        total = total + (mean.log() if log[d] else mean)
    return total


@torch.no_grad()
def abs_rel(network: nn.Module, data: Data, settings: Settings) -> dict[int, float]:
    """AbsRel of each dataset: mean over its images of |predicted - true| / true at their pixels.

    Each image with its first variant; predictions are clipped to the dataset's depth range.
    """
    examples = data.validation
    features = torch.from_numpy(examples.features[examples.texts[examples.first[:-1]]])
    errors = []
    for rows in torch.arange(len(examples)).split(1024):
        scale, shift = network((features[rows].float() - data.mean) * data.factor)
        y, true = (torch.from_numpy(a[rows]).float() for a in (examples.relative, examples.metric))
        dataset = examples.dataset[rows]
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
