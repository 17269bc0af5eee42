"""Pipeline files: stages and their non-default options, one TOML file for a whole chain.

doc = "What it is for."

[dataset.nyuv2]                      # one table a dataset, its options inside
[dataset.nyuv2.detect]               # options for this dataset alone
segments = "rsa-release:../RSA"

[captions]                           # for every dataset; several tables as [[captions]]
style = "occupancy"
[embed]                              # reads each captions table of this file
encoder = "clip-rn50"
[depth]
depth_model = "depth-anything-v2-small"
[train-head]
name = "nyu"
[evaluate]                           # several as [[train-head]] and [[evaluate]]
"""

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import registry
from ..common import bounded, options, own_code, typed
from ..common.errors import RsaDataError, UsageError, unknown
from ..common.files import shipped
from ..datasets import index
from ..datasets.roots import open_root
from ..store.tables import WorkDir
from . import chains, stages
from .chains import RunOptions
from .pipeline_changes import change, rename
from .stages import ConfiguredStage


@dataclass(frozen=True)
class DatasetEntry:
    """[dataset.NAME]: a dataset and the row stages to run over it.

    builder : of the registry. root : where its files lie, as it is written in the file.
    options : of the dataset. stages : in their order, with the options that hold for this dataset;
    one that writes several tables stands there for each.
    """

    name: str
    builder: str
    root: str | None
    options: dict[str, Any]
    stages: tuple[ConfiguredStage, ...]


@dataclass(frozen=True)
class Step:
    """[train-head], [evaluate] ...: a step over whole tables, with the options given for it."""

    name: str
    options: dict[str, Any]


@dataclass(frozen=True)
class PipelineFile:
    """A pipeline file, every option of it checked against the signature that it is for."""

    doc: str
    datasets: dict[str, DatasetEntry]
    steps: list[Step]


def load(path: Path, changes: Mapping[str, Any] | None = None) -> PipelineFile:
    """Reads and checks a pipeline file.

    Parameters
    ----------
    path : a TOML file, or the name of one that is shipped (`rsa-data list jobs`).
    changes : {"embed.weights": value, "dataset.nyuv2.root": value}, put over the file.

    Raises UsageError, with file, place and nearest name, before anything is loaded or written.
    """
    known = shipped("pipelines") / f"{path}.toml"
    file = path if path.exists() else known
    if not file.exists():
        raise unknown("pipeline file", str(path), [p.stem for p in known.parent.glob("*.toml")])
    try:
        raw = bounded.read_toml(file)
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: not a TOML file: {error}") from error
    own_code.allow([*_words(raw), *map(str, (changes or {}).values())])
    if path.is_file() and (folder := str(path.parent.resolve())) not in sys.path:
        sys.path.append(folder)  # modules beside the file may be named in it
    rename(raw)
    for where, value in (changes or {}).items():
        change(raw, where.split("."), value, f"{path}: {where}")
    try:
        return _parsed(raw, str(path))
    except RsaDataError as error:
        raise UsageError(str(error)) from error


def _words(value: Any) -> Iterator[str]:
    """Every text in the tables of a pipeline file."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, (dict, list)):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _words(inner)


def _parsed(raw: dict[str, Any], where: str) -> PipelineFile:
    top = ("doc", "dataset", *stages.names(), *registry.STEPS)
    for name in raw:
        if name not in top:
            raise UsageError(f"{where}: {unknown('table', name, top)}")
    doc = typed.convert(raw.get("doc", ""), str, f"{where}.doc")
    shared = {name: _tables(raw[name], f"{where}.{name}") for name in stages.names() if name in raw}
    tables = typed.convert(raw.get("dataset", {}), dict[str, Any], f"{where}.dataset")
    if not tables:
        raise UsageError(f"{where}: expected at least one [dataset.NAME]; found none")
    datasets = {
        name: _dataset(name, table, shared, f"{where}.dataset.{name}")
        for name, table in tables.items()
    }
    steps = []
    for name in registry.STEPS:
        for given in _tables(raw.get(name, []), f"{where}.{name}"):
            options.bind(_function(name), given, f"{where}: {name}")
            steps.append(Step(name, given))
    return PipelineFile(doc, datasets, steps)


def _tables(value: Any, where: str) -> list[dict[str, Any]]:
    """The tables of [NAME] or [[NAME]]."""
    several = value if isinstance(value, list) else [value]
    return typed.convert(several, list[dict[str, Any]], where)


def _dataset(
    name: str, value: Any, shared: dict[str, list[dict[str, Any]]], where: str
) -> DatasetEntry:
    """A [dataset.NAME] table; shared : options of the stages for every dataset.

    What stands in [dataset.NAME.STAGE] goes over each of those; [[dataset.NAME.STAGE]] adds tables.
    """
    table = typed.convert(value, dict[str, Any], where)
    own = {key: value for key, value in table.items() if isinstance(value, (dict, list))}
    for stage in own:
        if stage not in stages.names():
            raise unknown(f"stage in [dataset.{name}]", stage, stages.names())
    builder = typed.convert(table.get("builder", name), str, f"{where}.builder")
    root = typed.convert(table["root"], str, f"{where}.root") if "root" in table else None
    rest = {k: v for k, v in table.items() if k not in own and k not in ("builder", "root")}
    index.open_dataset(f"{builder}:{name}", rest)
    bound: list[ConfiguredStage] = []
    for stage in stages.names():
        mine = own.get(stage, {})
        tables = shared.get(stage, [])
        if isinstance(mine, list):
            tables = [*tables, *_tables(mine, f"{where}.{stage}")]
        elif mine:
            tables = [{**one, **mine} for one in tables or [{}]]
        bound += _several(stage, tables, f"{where}.{stage}")
    return DatasetEntry(name, builder, root, rest, tuple(bound))


def _several(stage: str, tables: list[dict[str, Any]], where: str) -> list[ConfiguredStage]:
    """A stage for each of its tables; raises UsageError where two would be one table."""
    found = [stages.bind(stage, table) for table in tables]
    labels = [one.label or (one.default_label(None) if one.stage.selector else "") for one in found]
    if again := next((label for label in labels if labels.count(label) > 1), None):
        raise UsageError(
            f"{where}: expected tables of different names, found {again!r} twice. Give one of them "
            'a label = "NAME"'
        )
    return found


def _function(step: str) -> Callable[..., Any]:
    found: Callable[..., Any] = registry.resolve("step", registry.STEPS, step)
    return found


def run(
    work: WorkDir,
    pipeline: PipelineFile,
    how: RunOptions,
    report_step: Callable[[str, Any], None],
) -> None:
    """Runs a loaded file: the row stages over each dataset, then the steps over whole tables.

    report_step : called with the name of such a step and what it returned.
    """
    for entry in pipeline.datasets.values():
        _run_stages(work, entry, how)
    if how.plan is not None:
        return
    heads = [s.options.get("name", "head") for s in pipeline.steps if s.name == "train-head"]
    for step in pipeline.steps:
        given = {"datasets": list(pipeline.datasets), **step.options}
        if step.name in ("evaluate", "robustness"):
            given.setdefault("head", heads[0] if heads else "head")
        bound = options.bind(_function(step.name), given, step.name)
        report_step(step.name, options.call(_function(step.name), work, bar=how.bar, **bound))


def _run_stages(work: WorkDir, entry: DatasetEntry, how: RunOptions) -> None:
    choice = entry.name if entry.builder == entry.name else f"{entry.builder}:{entry.name}"
    root = None if entry.root is None else open_root(entry.root)
    source = next((s for s in entry.stages if s.stage.reads is None), None)
    chains.samples(work, choice, entry.options, root=root, source=source)
    for configured in entry.stages:
        reads = configured.stage.reads
        first_of_kind = next(s for s in entry.stages if s.stage.kind == configured.stage.kind)
        if configured is first_of_kind and any(_makes_for(configured, s) for s in entry.stages):
            continue  # it runs as the first half of that stage, where that one needs it
        read = [s for s in entry.stages if reads is not None and s.stage.kind == reads.kind]
        if reads is None or reads.made_first:
            first = read[0] if read else None
            chains.chain(work, configured, entry.name, how, root=root, first=first)
            continue
        labels: list[str | None] = [one.label or one.default_label(None) for one in read]
        for label in labels or [None]:
            chains.chain(work, configured, entry.name, how, root=root, wanted=label)


def _makes_for(configured: ConfiguredStage, later: ConfiguredStage) -> bool:
    reads = later.stage.reads
    return reads is not None and reads.made_first and reads.kind == configured.stage.kind
