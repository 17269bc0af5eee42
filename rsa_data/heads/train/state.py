"""What a training has come to after some epochs, and how that lies on disk."""

import io
import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import torch
from safetensors import SafetensorError
from safetensors.torch import load as from_safetensors
from safetensors.torch import save as to_safetensors

from ...common.errors import RsaDataError
from ...store import schemas


@dataclass
class State:
    """What a run has come to after some epochs; enough to continue as if nothing had happened.

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


_ROWS = ("weights", "moment1", "moment2", "best")


def to_checkpoint(state: State, training: str) -> bytes:
    """checkpoint.safetensors; training : fingerprint of what the run follows from."""
    history = [
        {**row, "errors": {str(d): e for d, e in row["errors"].items()}} for row in state.history
    ]
    about = {"identity": training, "steps": state.steps, "history": history}
    rows = torch.stack([getattr(state, name) for name in _ROWS])
    return to_safetensors({"rows": rows}, {"state": json.dumps(about)})


def from_checkpoint(data: bytes | None, training: str, parameters: int) -> State | None:
    """The state that a killed run left; None when there is none, or it is of another training.

    parameters : how many the network has. Raises RsaDataError when the file is broken.
    """
    if data is None:
        return None
    try:
        length = int.from_bytes(data[:8], "little")
        about = json.loads(json.loads(data[8 : 8 + length])["__metadata__"]["state"])
        if about["identity"] != training:
            return None
        tensors = from_safetensors(data)["rows"]
        if tensors.shape != (len(_ROWS), parameters) or not tensors.isfinite().all():
            raise ValueError(f"expected finite rows of {parameters:,} numbers")
        history = [
            {**row, "errors": {int(d): e for d, e in row["errors"].items()}}
            for row in about["history"]
        ]
        weights, moment1, moment2, best = tensors
        return State(weights, moment1, moment2, best, about["steps"], history)
    except (ValueError, KeyError, TypeError, AttributeError, SafetensorError) as error:
        raise RsaDataError(
            f"checkpoint.safetensors: broken: {error}. --start-over trains from the beginning"
        ) from error


def to_history(state: State, names: list[str]) -> bytes:
    """history.parquet: a row for each epoch and dataset."""
    rows = [
        {**row, "dataset": names[d], "val_abs_rel": error, "best": row["epoch"] == state.best_epoch}
        for row in state.history
        for d, error in row["errors"].items()
    ]
    columns = {name: [row[name] for row in rows] for name in schemas.schema("history").names}
    table = schemas.from_columns("history", columns)
    schemas.check("history", table)
    buffer = io.BytesIO()
    pq.write_table(table, buffer)
    return buffer.getvalue()
