"""One training run: its examples, its state on disk, and the head that it leaves."""

import hashlib
import time
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import torch

from ... import registry
from ...common.errors import RsaDataError
from ...common.failpoints import failpoint
from ...datasets import labels
from ...store.table_names import head_folder
from ...store.tables import Description as TableDescription
from ...store.tables import Table, WorkDir, fingerprint
from .. import description as forms
from ..architectures.layers import Head
from ..checkpoint import FORMAT, ScaleHead, build_network
from ..description import Description, Used, Validation
from ..predict.calibration import calibrate
from .batches import images_in_an_epoch
from .optimization import Settings, begin, fit
from .plan import Described, Plan
from .state import State, from_checkpoint, to_checkpoint, to_history
from .trained import Trained
from .windows import Windows

_FILES = ("head.json", "head.safetensors", "history.parquet", "checkpoint.safetensors")


def run(
    work: WorkDir, plan: Plan, bar: Callable[[str, int], Any] | None, start_over: bool
) -> Trained:
    """Trains, or continues training, and writes the head; returns at once when it is there."""
    store, folder = work.store, head_folder(plan.name)
    table = work.table("heads", plan.name)
    if start_over:
        table.start_over()  # first: another training that still runs writes no head without it
        for file in _FILES:
            store.delete(f"{folder}/{file}")
    if table.exists():
        table.bind(plan.described)
    training = fingerprint(msgspec.to_builtins(plan.described))
    if (done := store.read(f"{folder}/head.json")) is not None:
        about = forms.read(done, f"{store.location}/{folder}/head.json")
        if about.training in (msgspec.UNSET, training):
            store.delete(f"{folder}/checkpoint.safetensors")  # of a run killed at its very end
            return Trained(f"{store.location}/{folder}", about)

    torch.set_num_threads(plan.machine.threads)
    examples = Windows(work, plan)
    table.bind(plan.described)
    cls = registry.resolve("head", registry.HEADS, plan.model.head)
    architecture = {"name": plan.model.head, **cls.sizes(examples.inputs)}
    network = _first_network(plan, architecture, examples)
    parameters = sum(p.numel() for p in network.parameters())
    left = store.read(f"{folder}/checkpoint.safetensors")
    state = from_checkpoint(left, training, parameters) or begin(network)
    settings = _settings(plan, examples)
    total = plan.training.epochs * settings.epoch
    shown = bar(f"train {plan.name}", total) if bar else None
    if shown:
        shown.update(len(state.history) * settings.epoch)

    written = time.monotonic()

    def after_epoch(state: State) -> None:
        nonlocal written
        if time.monotonic() - written >= plan.machine.checkpoint_every:
            failpoint("checkpoint")
            _still_ours(table, plan)
            store.write(f"{folder}/checkpoint.safetensors", to_checkpoint(state, training))
            written = time.monotonic()

    tick = shown.update if shown else lambda images: None
    state = fit(network, examples, settings, state, after_epoch, tick)
    if shown:
        shown.close()
    torch.nn.utils.vector_to_parameters(state.best, network.parameters())
    history = to_history(state, [source.dataset for source in plan.sources])
    about = describe(work, plan, examples, state, architecture)
    about = msgspec.structs.replace(
        about, training=training, history=hashlib.sha256(history).hexdigest(), parameters=parameters
    )
    head = ScaleHead(network, about, examples.mean, examples.factor, examples.reference)
    head.about = msgspec.structs.replace(about, **calibrate(head, examples.validation))
    files = {"history.parquet": history, **head.files()}
    commit(table, plan, files)
    store.delete(f"{folder}/checkpoint.safetensors")
    written_about = forms.read(files["head.json"], "head.json")
    return Trained(f"{store.location}/{folder}", written_about)


def commit(table: Table, plan: Plan, files: dict[str, bytes]) -> None:
    """Writes a head's files, head.json last; only while the folder is still this training's.

    Another training may have taken the name over with --start-over, and then its description
    stands there. Each file appears only where none is, so that what a slower training still
    writes never replaces a file of the faster one; head.json says by digests what belongs to it.
    Raises RsaDataError when the folder is not this training's any more.
    """
    for name, content in files.items():
        while not table.store.create(f"{table.path}/{name}", content):
            _still_ours(table, plan)
            # A leftover of a training that was pushed aside or killed.
            table.store.delete(f"{table.path}/{name}")
    try:
        _still_ours(table, plan)
    except RsaDataError:
        if table.store.read(f"{table.path}/head.json") == files["head.json"]:
            table.store.delete(f"{table.path}/head.json")
        raise


def _still_ours(table: Table, plan: Plan) -> None:
    """Raises RsaDataError unless the folder's description is the plan's."""
    if not table.exists() or table.described(Described) != plan.described:
        raise RsaDataError(
            f"{table}: another training has taken this name over with --start-over: this one "
            "stopped and wrote no head. Train under another --name to keep both"
        )


def _settings(plan: Plan, examples: Windows) -> Settings:
    names = [source.dataset for source in plan.sources]
    limits = np.array([plan.limits[name] for name in names])
    batch = plan.training.batch or int(np.clip(examples.total // 16, 16, 256))
    return Settings(
        goal=plan.goal,
        training=plan.training,
        loss=registry.resolve("loss", registry.LOSSES, plan.goal.loss),
        batch=batch,
        epoch=images_in_an_epoch(examples.images, batch, plan.training.batches),
        log=np.array([name in plan.goal.log_loss for name in names]),
        unit=np.ones(len(names)) if plan.goal.units == "metres" else examples.mean_depth,
        weight=_weights(examples.images, plan.goal.balance),
        min_depth=limits[:, 0],
        max_depth=limits[:, 1],
    )


def _first_network(plan: Plan, architecture: dict[str, Any], examples: Windows) -> Head:
    """A network drawn from the seed, whose output begins at the datasets' typical scale and shift.

    y may be in any unit (0 to 1, 0 to 10,000), so without that the first steps, or all of them,
    go into finding its range. The outputs are the last layers of `scale_net` and `shift_net`; a
    head without networks of these names begins as it is.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(plan.training.seed)
        network = build_network(architecture, examples.dim)
    if plan.model.initial == "random":
        return network
    with torch.no_grad():
        outputs = ("scale_net", "shift_net")
        for output, value in zip(outputs, examples.typical, strict=True):
            if isinstance(branch := getattr(network, output, None), torch.nn.Sequential):
                branch[-1].get_parameter("bias").fill_(float(np.log(value)))
    return network


def _weights(images: np.ndarray, balance: str) -> np.ndarray:
    """What multiplies the loss of each dataset's images; 1 on average over all images."""
    if balance != "datasets":
        return np.ones(len(images))
    found: np.ndarray = images.sum() / (len(images) * images)
    return found


def describe(
    work: WorkDir, plan: Plan, examples: Windows, state: State, architecture: dict[str, Any]
) -> Description:
    """head.json: everything that says what the head is, and whether it fits other tables."""
    names = [source.dataset for source in plan.sources]
    best = state.history[state.best_epoch - 1]
    captions = {
        s.dataset: work.table(s.dataset, s.captions).description()
        for s in plan.sources
        if s.captions
    }
    return Description(
        format=FORMAT,
        architecture=architecture,
        features=msgspec.structs.replace(plan.features, dim=examples.dim),
        standardized=plan.model.standardize,
        depth_model=plan.depth_model,
        datasets={
            name: Used(
                images=int(examples.images[i]),
                validation_images=int(examples.validation_images[i]),
                validation=examples.how[i],
                synthetic=labels.is_synthetic(work, name),
                left_out=int(examples.left_out[i]),
                min_depth=plan.limits[name][0],
                max_depth=plan.limits[name][1],
                tables=plan.digests[name],
            )
            for i, name in enumerate(names)
        },
        segments={name: _source(work, name, about) for name, about in captions.items()},
        captions={name: about.options for name, about in captions.items()},
        options=plan.options,
        validation=Validation(
            epoch=state.best_epoch,
            abs_rel={names[d]: value for d, value in best["errors"].items()},
        ),
        epochs_run=len(state.history),
    )


def _source(work: WorkDir, dataset: str, captions: TableDescription) -> str:
    """segments/SOURCE of captions; what made their segments, whatever the label of the table."""
    table = work.table(dataset, captions.inputs[0])
    if not captions.inputs[0].startswith("segments/") or not table.exists():
        return captions.inputs[0]
    return f"segments/{table.description().options.get('source') or table.name.partition('/')[2]}"
