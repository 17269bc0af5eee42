"""A job is one row stage over one dataset: which tables it reads, which one it writes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..common.errors import RsaDataError, UsageError
from ..common.options import current
from ..datasets import index
from ..store.table_names import check_name, plain_name
from ..store.tables import Table, WorkDir
from . import stages
from .commands import making
from .stage import Options, Stage
from .stages import ConfiguredStage


@dataclass(frozen=True)
class Job:
    """One row stage over one dataset: everything a worker needs, in plain values.

    stage : its name. options : bound options of the user; inputs : tables read, the first decides
    what is counted; root : where the dataset's files lie, or None.
    """

    work: str
    dataset: str
    stage: str
    options: Options
    inputs: tuple[str, ...]
    output: str
    root: str | None

    @property
    def declared(self) -> Stage:
        """What the registry has under the stage's name."""
        return stages.stage(self.stage)

    def table(self, name: str) -> Table:
        """One of the job's tables."""
        return WorkDir(self.work).table(self.dataset, name)


def job(
    work: WorkDir,
    configured: ConfiguredStage,
    dataset: str,
    *,
    root: Path | None = None,
    upstream: str | None = None,
    start_over: bool = False,
) -> Job:
    """The job of a stage over a dataset; names are checked, nothing is loaded.

    upstream : the table that the stage reads besides samples, if these options read one.
    start_over : the table that is there will go, so that its options settle nothing.
    """
    stage, read = configured.stage, upstream and upstream.partition("/")[2]
    if stage.reads is None or upstream is None:
        inputs: tuple[str, ...] = ("samples",)
    else:
        inputs = (upstream, "samples") if stage.reads.with_samples else (upstream,)
    label = check_name(stage.name, configured.label or configured.default_label(read))
    _check_free(stage, label)
    output = f"{stage.folder.format(label=read)}/{label}"
    place = index.find_root(work, dataset, root)
    there = None if start_over else _options_of(work.table(dataset, output))
    return Job(
        work=work.store.location,
        dataset=dataset,
        stage=stage.name,
        options=stage.settle(configured.options, there),
        inputs=inputs,
        output=output,
        root=str(place) if place else None,
    )


def _options_of(table: Table) -> Options | None:
    """The options that a table was made with; None where there is none, or a damaged one."""
    try:
        return table.description().options if table.exists() else None
    except RsaDataError:
        return None  # said where the table is used


def _check_free(stage: Stage, label: str) -> None:
    """Refuses a label under which a later stage would write into the folder of another one."""
    every = [stages.stage(name) for name in stages.names()]
    for reader in every:
        if reader.reads and reader.reads.kind == stage.kind and "{label}" in reader.folder:
            folder = reader.folder.format(label=label)
            for other in every:
                if other.folder == folder:
                    raise UsageError(
                        f"--label {label}: expected another label; {folder} holds the tables of "
                        f"{other.name}"
                    )


def job_of(work: WorkDir, dataset: str, table: str) -> Job:
    """The job that makes a table that is there, from what its last run has left beside it.

    Raises RsaDataError when the table's description names other inputs than its stage reads.
    """
    there = work.table(dataset, table)
    description = there.description()
    inputs = description.inputs
    upstream = inputs[0] if inputs and inputs[0] != "samples" else None
    # Either may hold options by the names that they had in an older version.
    build = stages.stage(description.stage).build
    kept = current(build, description.options, warn=False)
    kept |= current(build, there.remembered(), warn=False)
    given = {**kept, "label": table.rpartition("/")[2]}
    configured = stages.bind(description.stage, given)
    reads = configured.stage.reads
    expected = reads is not None and reads.needed(configured.options)
    if expected != (upstream is not None):
        raise RsaDataError(
            f"{there}: inputs: expected the inputs of the stage {configured.stage.name}, "
            f"found {inputs}. Use --start-over to make the table again"
        )
    return job(work, configured, dataset, upstream=upstream)


def choose(work: WorkDir, dataset: str, kind: str, wanted: str | None, option: str) -> str:
    """The table `KIND/...` of a dataset: the wanted one, or the only one there is.

    wanted : its name, or the `module:attribute` that it was made by.
    """
    there = [name for name in work.tables(dataset) if name.startswith(kind + "/")]
    if wanted is not None:
        name = f"{kind}/{plain_name(wanted)}"
        if name in there:
            return name
    # What was refused or stopped at once may have left a table without any part.
    elif len(with_parts := [n for n in there if work.table(dataset, n).parts()] or there) == 1:
        return with_parts[0]
    found = ", ".join(name.removeprefix(kind + "/") for name in there) or "none"
    if wanted is None and there:
        raise UsageError(f"{dataset}: several {kind} tables: choose one with {option}: {found}")
    name = f"{kind}/{wanted or '...'}"
    having = [other for other in work.datasets() if name in work.tables(other)]
    others = f", or leave it out: {' '.join(f'--dataset {other}' for other in having)}"
    raise RsaDataError(
        f"{work.store.location}/{dataset}: expected {name}; found {found}. Make it first: "
        f"{making(work, dataset, name)}{others if having else ''}"
    )


def plain(value: Any) -> Any:
    """A value as JSON can hold it: paths become strings."""
    return value if isinstance(value, (int, float, str, bool, type(None))) else str(value)


def remember(job: Job) -> None:
    """Keeps where the job found its files, for `job_of`; no part depends on it."""
    stage = job.declared
    names = (*stage.local, stage.selector)
    kept = {name: plain(value) for name, value in job.options.items() if name in names}
    job.table(job.output).remember(kept)
