"""train-head: from the parts of any number of datasets to one head, checked before it begins."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec

from ... import registry
from ...common.errors import RsaDataError, UsageError, unknown
from ...datasets import index
from ...datasets.dataset import Dataset
from ...datasets.found_samples import check_once
from ...store.tables import WorkDir
from .. import belong
from ..belong import Source, Tables
from ..description import DepthModel
from ..sources import sources as find_sources
from .plan import Goal, Machine, Model, Parts, Plan, Training
from .trained import Trained, directions


def train_head(
    work: WorkDir,
    bar: Callable[[str, int], Any] | None = None,
    *,
    tables: Tables = Tables(),
    model: Model = Model(),
    name: str = "head",
    goal: Goal = Goal(),
    training: Training = Training(),
    machine: Machine = Machine(),
    start_over: bool = False,
) -> Trained:
    """Trains a head on the tables of a work dir and writes it to WORK/heads/NAME.

    A run that was killed continues from its last finished epoch, to the same weights on the same
    machine; a head that is finished is left as it is.

    Parameters
    ----------
    name : folder of the head below WORK/heads.
    start_over : throw away the head of this name, finished or not, and train again.

    Raises UsageError when the options do not go together, RsaDataError when tables are missing or
    do not belong together.
    """
    if training.precision == "auto":
        training = replace(training, precision=_precision())
    if not 0 < training.validation <= 0.5:
        raise UsageError(
            f"--validation: expected more than 0, at most 0.5; found {training.validation}"
        )
    if training.pixels < 0:
        raise UsageError(f"--pixels: expected 0 or more, found {training.pixels}")
    registry.resolve("loss", registry.LOSSES, goal.loss)
    head = registry.resolve("head", registry.HEADS, model.head)
    if head.reads and model.control == "dataset":
        raise UsageError(
            f"--control dataset: expected a head of one vector, such as mlp5; --head {model.head} "
            f"reads {' and '.join(head.reads)}"
        )
    reads = head.reads or ("text",)
    if training.redraw and not {"text", "objects"} & set(reads):
        raise UsageError(
            f"--redraw: expected a head that reads captions or objects; --head {model.head} reads "
            f"{' and '.join(reads)}"
        )
    model = replace(model, standardize=model.standardize and head.standardize)

    sources = find_sources(work, tables, model.head, head.reads)
    found = {
        "/".join([s.dataset, *(feed.table for feed in s.inputs)]): belong.features_of(work, s)
        for s in sources
    }
    belong.same("embeddings", {where: about.identity() for where, about in found.items()})
    depths = {s.dataset: belong.depth_identity(work.table(s.dataset, s.depth)) for s in sources}
    depth = belong.same("depth", {f"{n}/depth": pair[0] for n, pair in depths.items()})
    geometry = {n: pair[1] for n, pair in depths.items()}

    limits, parts, digests = {}, {}, {}
    for source in sources:
        dataset = index.load_dataset(work, source.dataset)
        limits[source.dataset] = (dataset.min_depth, dataset.max_depth)
        parts[source.dataset] = _parts(work, source, dataset)
        made = [belong.current(work, source, n) for n in parts[source.dataset].numbers]
        digests[source.dataset] = belong.together(made)
    for dataset_name in goal.log_loss:
        if dataset_name not in parts:
            raise unknown("dataset in --log-loss", dataset_name, parts)

    from .training_run import run

    plan = Plan(
        name=name,
        sources=sources,
        parts=parts,
        limits=limits,
        digests=digests,
        features=next(iter(found.values())),
        depth_model=msgspec.convert({**depth, "geometry": geometry}, DepthModel),
        tables=tables,
        model=model,
        goal=goal,
        training=training,
        machine=machine,
    )
    trained = run(work, plan, bar, start_over)
    chosen = (plan.depth_model.options or {}).get("depth_model") or plan.depth_model.model
    numbers = {name: found.train for name, found in parts.items()}
    return replace(trained, directions=directions(work, sources, numbers, str(chosen)))


def _parts(work: WorkDir, source: Source, dataset: Dataset) -> Parts:
    """The parts of a dataset that may be read, by what they are for."""
    samples = work.table(source.dataset, "samples")
    splits = {number: samples.receipt(number).split for number in samples.parts()}
    chosen: dict[str, list[int]] = {"train": [], "validation": [], "test": []}
    for number, split in splits.items():
        chosen[dataset.role(split)].append(number)
    if not chosen["train"]:
        raise RsaDataError(
            f"{source.dataset}: expected training images; found only the test splits "
            f"{', '.join(sorted(set(splits.values())))}, which no training may read"
        )
    check_once(samples, [*chosen["train"], *chosen["validation"]])
    names = sorted({splits[number] for number in chosen["validation"]})
    return Parts(chosen["train"], chosen["validation"], " and ".join(names))


def _precision() -> Any:
    """bfloat16 where the processor has instructions for it, else float32."""
    import torch

    # Not public yet, so a later torch without them means float32.
    has = (getattr(torch.cpu, f"_is_{n}_supported", None) for n in ("avx512_bf16", "amx_tile"))
    return "bfloat16" if any(ask() for ask in has if ask) else "float32"
