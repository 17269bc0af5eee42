"""Commands that make tables, as messages name them: whole, so that they run as they are printed."""

import inspect
import shlex
from typing import Any

from ..common import options as binding
from ..common import own_code
from ..store.tables import Table, WorkDir
from . import stages
from .stage import GIVEN, Stage


def again(work: WorkDir, table: Table, more: str = "", dataset: str | None = None) -> str:
    """The command that makes more of a table.

    more : further options. dataset : make the like for this one instead, in the same work dir.
    """
    about = table.description()
    stage = stages.stage(about.stage)
    known = binding.parameters(stage.build)
    given = binding.current(stage.build, about.options, warn=False)
    if dataset is None:
        given |= binding.current(stage.build, table.remembered(), warn=False)
    if stage.selector is not None and (code := (about.identity or {}).get("code")):
        given[stage.selector] = code
    words = [f"rsa-data {stage.name} --dataset {shlex.quote(dataset or table.dataset)}"]
    for name, value in given.items():
        if name in known and name not in GIVEN:
            words += _option(name, value, known[name], always=name == stage.selector)
    words += _reads(work, table, stage, elsewhere=dataset is not None)
    chosen = str(given.get(stage.selector)) if stage.selector else ""
    label = table.name.rpartition("/")[2]
    if stage.selector and stages.label_of(chosen, stage.choices) != label:
        words.append(f"--label {shlex.quote(label)}")
    return " ".join(words) + more + work.option


def making(work: WorkDir, dataset: str, name: str) -> str:
    """The command that makes a table which a dataset lacks: as another dataset has it, if one has.

    name : KIND/LABEL, embeddings/STYLE/ENCODER, or KIND/... for any.
    """
    for other in work.datasets():
        table = work.table(other, name)
        if other != dataset and table.exists() and stages.known(table.description().stage):
            return again(work, table, dataset=dataset)
    kind, *labels = name.split("/")
    own = [s for s in map(stages.stage, stages.names()) if s.folder == name.rpartition("/")[0]]
    stage = own[0] if own else stages.maker(kind)
    option = ""
    if not own and stage.reads is not None and len(labels) > 1 and labels[0] != "...":
        option += f" --{stage.reads.option} {shlex.quote(labels[0])}"
    choice = own_code.typed(labels[-1]) or labels[-1]
    if stage.selector and choice != "..." and (stage.choices is None or choice in stage.choices):
        option += f" {binding.flag(stage.selector)} {shlex.quote(choice)}"
    return f"rsa-data {stage.name} --dataset {shlex.quote(dataset)}{option}{work.option}"


def _option(name: str, value: Any, known: inspect.Parameter, always: bool) -> list[str]:
    """The words of one option; none for its default."""
    default = known.default
    told = str(default) if not isinstance(default, (bool, int, float, tuple)) else default
    if value is None or (not always and value in (default, told)):
        return []
    if isinstance(value, bool):
        return [binding.flag(name) if value else binding.flag(f"no-{name}")]
    several = value if isinstance(value, (list, tuple)) else [value]
    return [f"{binding.flag(name)} {shlex.quote(str(one))}" for one in several]


def _reads(work: WorkDir, table: Table, stage: Stage, elsewhere: bool) -> list[str]:
    """The option that chooses what a table was made from, where it is not the only one."""
    inputs = table.description().inputs
    if stage.reads is None or not inputs or inputs[0] == "samples":
        return []
    kind, _, label = inputs[0].partition("/")
    several = sum(name.startswith(f"{kind}/") for name in work.tables(table.dataset)) > 1
    return [f"--{stage.reads.option} {shlex.quote(label)}"] if several or elsewhere else []
