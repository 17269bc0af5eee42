"""One training run: its examples, its state on disk, and the head that it leaves."""

import io
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import pyarrow.parquet as pq
import torch
from safetensors import SafetensorError
from safetensors.torch import load as from_safetensors
from safetensors.torch import save as to_safetensors

from ...common.errors import RsaDataError
from ...store import schemas
from ...store.failpoints import failpoint
from ...store.tables import WorkDir, fingerprint
from ..checkpoint import FORMAT, ScaleHead, build_network
from ..predict.calibration import calibrate
from .examples import Source
from .optimization import State, begin, fit
from .settings import Settings
from .train_head import Trained
from .windows import Windows

# Options that never change what comes out.
_LOCAL = ("memory", "checkpoint_every")


@dataclass(frozen=True)
class Plan:
    """All that decides the head, checked: see `train_head`.

    numbers, limits, geometry, digests : by dataset: training parts; (min, max) depth, m; the depth
        model's input geometry; digest of the training parts of each table.
    widths : how many features each table of features gives.
    """

    name: str
    sources: list[Source]
    numbers: dict[str, list[int]]
    limits: dict[str, tuple[float, float]]
    features: dict[str, Any]
    widths: list[int]
    architecture: dict[str, Any]
    depth_model: dict[str, Any]
    geometry: dict[str, dict[str, Any]]
    digests: dict[str, dict[str, str]]
    options: dict[str, Any]

    @property
    def identity(self) -> "Training":
        """What another run must share to be the same run."""
        options = {k: v for k, v in self.options.items() if k not in _LOCAL}
        return Training(options=options, inputs=self.digests)


class Training(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """_table.json of a head: what its training follows from; inputs : digests by dataset, table."""

    stage: str = "train-head"
    schema: str = "history"
    version: int = 1
    options: dict[str, Any]
    inputs: dict[str, dict[str, str]]


def run(
    work: WorkDir, plan: Plan, bar: Callable[[str, int], Any] | None, start_over: bool
) -> Trained:
    """Trains, or goes on training, and writes the head; returns at once when it is there."""
    store, folder, options = work.store, f"heads/{plan.name}", plan.options
    table = work.table("heads", plan.name)
    if start_over:
        for file in ("head.json", "head.safetensors", "history.parquet", "checkpoint.safetensors"):
            store.delete(f"{folder}/{file}")
        table.start_over()
    if table.exists():
        table.bind(plan.identity)
    if (done := store.read(f"{folder}/head.json")) is not None:
        store.delete(f"{folder}/checkpoint.safetensors")  # of a run killed at its very end
        return Trained(f"{store.location}/{folder}", json.loads(done))

    torch.set_num_threads(options["threads"])
    examples = Windows(work, plan)
    table.bind(plan.identity)
    names = [source.dataset for source in plan.sources]
    network = _first_network(plan, examples)
    limits = np.array([plan.limits[name] for name in names])
    settings = Settings(
        **{
            **{key: options[key] for key in Settings.__dataclass_fields__ if key in options},
            "batch": options["batch"] or int(np.clip(examples.total // 16, 16, 256)),
        },
        log=np.array([name in options["log_loss"] for name in names]),
        unit=np.ones(len(names)) if options["units"] == "metres" else examples.mean_depth,
        weight=_weights(examples.images, options["balance"]),
        min_depth=limits[:, 0],
        max_depth=limits[:, 1],
    )
    identity = fingerprint(plan.identity)
    state = _resume(store.read(f"{folder}/checkpoint.safetensors"), identity) or begin(network)
    shown = bar(f"train {plan.name}", options["epochs"] * examples.total) if bar else None
    if shown:
        shown.update(len(state.history) * examples.total)

    written = time.monotonic()

    def after_epoch(state: State) -> None:
        nonlocal written
        if time.monotonic() - written >= options["checkpoint_every"]:
            failpoint("checkpoint")
            store.write(f"{folder}/checkpoint.safetensors", _checkpoint(state, identity))
            written = time.monotonic()

    state = fit(
        network,
        examples,
        settings,
        state,
        after_epoch,
        shown.update if shown else lambda images: None,
    )
    if shown:
        shown.close()
    torch.nn.utils.vector_to_parameters(state.best, network.parameters())
    description = describe(work, plan, examples, state, network)
    head = ScaleHead(network, description, examples.mean, examples.factor, examples.reference)
    description.update(calibrate(head, examples.validation))
    store.write(f"{folder}/history.parquet", _history(state, names))
    head.save(store, folder)
    store.delete(f"{folder}/checkpoint.safetensors")
    return Trained(f"{store.location}/{folder}", description)


def _first_network(plan: Plan, examples: Windows) -> torch.nn.Module:
    """A network drawn from the seed, whose output begins at the datasets' typical scale and shift.

    y may be in any unit (0 to 1, 0 to 10,000), so without that the first steps, or all of them,
    go into finding its range. The outputs are the last layers of `scale_net` and `shift_net`; a
    head without networks of these names begins as it is.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(plan.options["seed"])
        network = build_network(plan.architecture, examples.dim)
    if plan.options["initial"] == "random":
        return network
    with torch.no_grad():
        outputs = ("scale_net", "shift_net")
        for output, value in zip(outputs, examples.typical, strict=True):
            if isinstance(branch := getattr(network, output, None), torch.nn.Sequential):
                branch[-1].get_parameter("bias").fill_(float(np.log(value)))
    return network


def _weights(images: np.ndarray, balance: str) -> np.ndarray:
    """What multiplies the loss of each dataset's images; 1 on average over all images."""
    if balance == "images":
        return np.ones(len(images))
    return images.sum() / (len(images) * images)


def describe(
    work: WorkDir, plan: Plan, examples: Windows, state: State, network: torch.nn.Module
) -> dict[str, Any]:
    """head.json: everything that says what the head is, and whether it fits other tables."""
    names = [source.dataset for source in plan.sources]
    best = state.history[state.best_epoch - 1]
    return {
        "format": FORMAT,
        "architecture": plan.architecture,
        "parameters": sum(p.numel() for p in network.parameters()),
        "features": {**plan.features, "dim": examples.dim},
        "standardized": plan.options["standardize"],
        "depth_model": {**plan.depth_model, "geometry": plan.geometry},
        "datasets": {
            name: {
                "images": int(examples.images[i]),
                "validation_images": int(examples.validation_images[i]),
                "validation": examples.how[i],
                "left_out": int(examples.left_out[i]),
                "min_depth": plan.limits[name][0],
                "max_depth": plan.limits[name][1],
                "tables": plan.digests[name],
            }
            for i, name in enumerate(names)
        },
        # What found the objects, so that new images are described by the same.
        "segments": {
            s.dataset: work.table(s.dataset, s.captions).description().inputs[0]
            for s in plan.sources
            if s.captions
        },
        "captions": {
            s.dataset: work.table(s.dataset, s.captions).description().options
            for s in plan.sources
            if s.captions
        },
        "options": {k: v for k, v in plan.options.items() if k not in _LOCAL},
        "validation": {
            "epoch": state.best_epoch,
            "abs_rel": {names[d]: value for d, value in best["errors"].items()},
        },
        "epochs_run": len(state.history),
    }


def _history(state: State, names: list[str]) -> bytes:
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


_ROWS = ("weights", "moment1", "moment2", "best")


def _checkpoint(state: State, identity: str) -> bytes:
    history = [
        {**row, "errors": {str(d): e for d, e in row["errors"].items()}} for row in state.history
    ]
    about = {"identity": identity, "steps": state.steps, "history": history}
    rows = torch.stack([getattr(state, name) for name in _ROWS])
    return to_safetensors({"rows": rows}, {"state": json.dumps(about)})


def _resume(data: bytes | None, identity: str) -> State | None:
    """The state that a killed run left; None when there is none."""
    if data is None:
        return None
    try:
        length = int.from_bytes(data[:8], "little")
        about = json.loads(json.loads(data[8 : 8 + length])["__metadata__"]["state"])
        rows = dict(zip(_ROWS, from_safetensors(data)["rows"], strict=True))
    except (ValueError, KeyError, SafetensorError) as error:
        raise RsaDataError(
            f"checkpoint.safetensors: broken: {error}. --start-over trains anew"
        ) from error
    if about["identity"] != identity:
        raise RsaDataError("checkpoint.safetensors is of another training: use --start-over")
    history = [
        {**row, "errors": {int(d): e for d, e in row["errors"].items()}} for row in about["history"]
    ]
    return State(**rows, steps=about["steps"], history=history)
