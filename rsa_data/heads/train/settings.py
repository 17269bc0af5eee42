"""How a head is trained: what the optimisation needs of the options, and the learning rate."""

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Settings:
    """How to train; `train_head` documents each.

    log : bool for each dataset: its loss in a batch enters as its logarithm.
    weight, unit, min_depth, max_depth : a number for each dataset: what multiplies the loss of its
        images; what its metric errors are divided by, m; the range of its depth, m.
    """

    loss: str
    supervision: str
    optimizer: str
    schedule: str
    lr: float
    end_lr: float
    warmup: float
    weight_decay: float
    clip: float
    epochs: int
    batch: int
    pixels: int
    patience: int
    precision: str
    seed: int
    log: np.ndarray
    weight: np.ndarray
    unit: np.ndarray
    min_depth: np.ndarray
    max_depth: np.ndarray


def learning_rate(settings: Settings, epoch: float) -> float:
    """The rate after so many epochs, a fraction included: warm-up, then cosine or polynomial."""
    done = epoch / settings.epochs
    if settings.schedule == "cosine":
        left = 0.5 * (1 + math.cos(math.pi * done))
    else:  # power 0.9, as in the released code
        left = (1 - done) ** 0.9
    rate = settings.end_lr + (settings.lr - settings.end_lr) * left
    return rate * min(1.0, (epoch + 1e-2) / settings.warmup) if settings.warmup else rate
