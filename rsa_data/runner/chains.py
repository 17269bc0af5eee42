"""What the commands do: each stage over one dataset, with what it needs made first."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..common.errors import RsaDataError, UsageError, unknown
from ..datasets import index
from ..datasets.roots import is_remote
from ..store.table_names import check_dataset_name, is_name
from ..store.tables import WorkDir
from . import jobs, limits, runs, selection, stages
from . import plan as planning
from .engines.pool import EngineOptions
from .jobs import Job
from .runs import Bar, Summary
from .stages import ConfiguredStage


@dataclass(frozen=True)
class RunOptions:
    """How a command runs: nothing here changes what comes out.

    report : called with a stage's name, its dataset and its summary as soon as it has ended.
    plan : called with a stage's name, its dataset and an estimate, instead of running it.
    """

    bar: Callable[[str, int], Bar]
    report: Callable[[str, str, Summary], None]
    split: str | None = None
    part_range: tuple[int, int] | None = None
    engine: EngineOptions = field(default_factory=EngineOptions)
    start_over: bool = False
    redo_failed: bool = False
    max_failures: float | int | None = None
    plan: Callable[[str, str, planning.Estimate], None] | None = None


def samples(
    work: WorkDir,
    choice: str,
    given: Mapping[str, Any],
    *,
    root: Path | None = None,
    source: ConfiguredStage | None = None,
    start_over: bool = False,
    say: Callable[[str], None] = lambda line: None,
) -> str:
    """Makes sure that a dataset is indexed and returns its name in the work dir.

    New files under the root are appended. Without a root the existing samples stay; where there
    are none, a source that carries its own index (`rsa-release:DIR`) gives them.

    Parameters
    ----------
    choice : a dataset of the registry, or `BUILDER:NAME`; or a name that the work dir knows.
    given : options of the dataset; none keeps those that it was indexed with.
    source : the first stage that will run over the samples.
    say : is given a line on files that the index leaves out.
    """
    table = work.table(check_dataset_name(choice.rpartition(":")[2]), "samples")
    if start_over:
        table.start_over()
    if not given and table.exists():
        dataset = index.load_dataset(work, table.dataset)
        kept = dict(table.description().options)
    else:
        dataset, kept = index.open_dataset(choice, given)
    sizes = {k: kept.pop(k) for k in ("part_size", "test_part_size") if k in kept}
    found = index.root_of(work, dataset, root)
    if root and not is_remote(root) and not root.is_dir() and dataset.prepare is None:
        raise RsaDataError(f"--root {root}: expected a folder; there is none")
    if dataset.prepare is not None:
        found = found or Path("data") / dataset.name
        if is_remote(found):
            raise UsageError(
                f"--root {found}: dataset {dataset.name} writes its files: expected a folder"
            )
        dataset.prepare(found)
    rows = None
    if found is None and source is not None and source.stage.selector and not table.complete():
        rows = source.stage.index(str(source.options[source.stage.selector]), dataset)
    if rows is not None:
        index.index(work, dataset, kept, root=None, samples=rows, **sizes)
    elif found is not None or not table.complete():
        left_out = index.index(work, dataset, kept, root=found, **sizes)
        if left_out:
            say(f"{dataset.name}: {left_out}")
    return dataset.name


def stage(
    work: WorkDir,
    configured: ConfiguredStage,
    dataset: str,
    how: RunOptions,
    *,
    root: Path | None = None,
    upstream: str | None = None,
) -> Summary:
    """Runs one row stage over one dataset and reports its summary; or plans it, see RunOptions.

    upstream : the table that is read besides samples, for stages and options that read one.
    """
    job = jobs.job(
        work, configured, dataset, root=root, upstream=upstream, start_over=how.start_over
    )
    return run_job(job, how)


def run_job(job: Job, how: RunOptions) -> Summary:
    """Runs a job, or estimates it, and reports it; RsaDataError where parts are left undone."""
    if how.plan is not None:
        estimate = planning.plan(job, split=how.split, part_range=how.part_range)
        how.plan(job.stage, job.dataset, estimate)
        return Summary.nothing(estimate.output)
    summary = runs.run(
        job,
        split=how.split,
        part_range=how.part_range,
        engine=how.engine,
        start_over=how.start_over,
        redo_failed=how.redo_failed,
        max_failures=how.max_failures,
        bar=how.bar,
    )
    how.report(job.stage, job.dataset, summary)
    if summary.undone:
        number, why = next(iter(summary.undone.items()))
        raise RsaDataError(
            f"{summary.output}: {len(summary.undone)} parts are not done; part {number}: {why}. "
            "Finished parts are kept: run the same command again"
        )
    failed, seen = summary.failed, summary.ok + summary.failed
    limits.check_failures(failed, seen, how.max_failures, lambda: summary.reasons, ended=True)
    return summary


def begin(
    work: WorkDir,
    configured: ConfiguredStage,
    choice: str,
    wanted: str | None,
    given: Mapping[str, Any] | None = None,
) -> ConfiguredStage | None:
    """The stage that makes the table which `configured` reads, as far as `wanted` asks for it.

    wanted : NAME or NAME:ARGUMENT of that stage, or the label of a table of the dataset `choice`.
    given : other options of that stage.

    Raises UsageError for unknown names, before anything is written.
    """
    reads = configured.stage.reads
    if reads is None or not reads.made_first or (wanted is None and not given):
        return None
    there = work.table(choice.rpartition(":")[2], f"{reads.kind}/{wanted}")
    if not given and wanted and is_name(wanted) and there.exists():
        return None
    first = stages.maker(reads.kind)
    assert first.selector is not None
    return stages.bind(
        first.name, {**(given or {}), **({first.selector: wanted} if wanted else {})}
    )


def chain(
    work: WorkDir,
    configured: ConfiguredStage,
    dataset: str,
    how: RunOptions,
    *,
    root: Path | None = None,
    wanted: str | None = None,
    first: ConfiguredStage | None = None,
) -> Summary:
    """A stage over a dataset; the table that it reads is chosen, and made first where it may be.

    Parameters
    ----------
    wanted : label of the table to read; None for the only one there is, or the default.
    first : the stage that makes this table, with its options; it runs first, over the same parts.
    """
    reads = configured.stage.reads
    if reads is None or not reads.needed(configured.options):
        return stage(work, configured, dataset, how, root=root)
    if not reads.made_first:
        table = jobs.choose(work, dataset, reads.kind, wanted, f"--{reads.option}")
        return stage(work, configured, dataset, how, root=root, upstream=table)
    there = [name for name in work.tables(dataset) if name.startswith(f"{reads.kind}/")]
    table = f"{reads.kind}/{wanted}" if wanted else there[0] if len(there) == 1 else ""
    before = replace(how, start_over=False)
    first = first or begin(work, configured, dataset, wanted)
    if first is None and table in there:
        numbers = set(selection.select(work, dataset, how.split, how.part_range))
        if not numbers <= set(work.table(dataset, table).parts()):
            run_job(jobs.job_of(work, dataset, table), before)
    else:
        asked = first is not None
        first = first or stages.bind(stages.maker(reads.kind).name, {})
        making = jobs.job(work, first, dataset, root=root)
        if not asked and len(there) > 1 and making.output not in there:
            # Raises: which of them is meant is the user's to say, not the default's.
            jobs.choose(work, dataset, reads.kind, None, f"--{reads.option}")
        run_job(making, before)
        table = making.output
    return stage(work, configured, dataset, how, root=root, upstream=table)


def known_datasets(work: WorkDir, wanted: tuple[str, ...]) -> list[str]:
    """The datasets asked for, or every dataset in the work dir; RsaDataError when there is none."""
    there = work.datasets()
    for name in wanted:
        if name not in there:
            raise unknown("dataset in this work dir", name, there)
    if not there:
        raise RsaDataError(
            f"{work.store.location}: no dataset there yet. Begin with "
            "`rsa-data captions --dataset NAME`, or name another --work"
        )
    return list(wanted) or there
