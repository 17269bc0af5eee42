"""One run of a row stage over one dataset: what is to do, doing it, and what came of it."""

import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from ..common.errors import RsaDataError, TransientError
from ..store.logs import RunLog
from ..store.tables import Description, WorkDir
from . import fingerprints, jobs, limits, parts
from .engines import dispatch
from .engines.pool import EngineOptions, Result, Task
from .jobs import Job
from .selection import accounted, need_inputs, reasons, select
from .summary import Bar as Bar
from .summary import Summary as Summary

_HERE = EngineOptions()

_SUMS = ("rows", "ok", "failed", "skipped", "bytes")

# After so many parts with unexpected errors the run stops: the fault is not in one part's input.
_UNEXPECTED = 3


def run(
    job: Job,
    *,
    split: str | None = None,
    part_range: tuple[int, int] | None = None,
    engine: EngineOptions = _HERE,
    start_over: bool = False,
    redo_failed: bool = False,
    max_failures: float | int | None = None,
    bar: Callable[[str, int], Bar],
) -> Summary:
    """Brings the job's output up to date for the selected parts.

    part_range : first and last part, last excluded. redo_failed : of the parts that are
        there, those with failed rows and those out of date; no others.
    max_failures : failed rows at which the run stops: a count (int), or a share of the rows of
        this run (float, 0 to 1). bar : (title, total rows) -> something that shows progress.
    """
    begun = time.monotonic()
    work, output = WorkDir(job.work), job.table(job.output)
    numbers = select(work, job.dataset, split, part_range)
    need_inputs(job, numbers)
    description = fingerprints.describe(job)
    if start_over:  # not before the call is known to make sense
        output.start_over()
    output.bind(description)
    jobs.remember(job)
    left = fingerprints.pending(job, description, numbers)
    tasks = [Task(number, redo=number in left.gone) for number in left.todo]
    if redo_failed:
        done = set(output.parts())
        numbers = [number for number in numbers if number in done]
        tasks = [task for task in tasks if task.number in done]
        again = [n for n in numbers if n not in left.todo and output.receipt(n).failed]
        tasks = sorted([*tasks, *(Task(n, redo=True) for n in again)], key=lambda t: t.number)
    came = job.table(job.inputs[0]).receipts(task.number for task in tasks)
    sizes = {receipt.part: receipt.units for receipt in came}
    undone: dict[int, str] = {}
    shown = bar(f"{job.dataset} {job.stage}", sum(sizes.values()))
    with RunLog(work, job.dataset, job.output) as log:
        if tasks:
            log.write("begin", table=str(output), parts=len(tasks), rows=sum(sizes.values()))
        try:
            for result in _watched(job, description, tasks, engine, shown, sizes, max_failures):
                _log_result(log, result, sizes[result.number])
                if result.error is not None:
                    undone[result.number] = _reason(result, undone, log)
        finally:
            shown.close()
        output.manifest(work.table(job.dataset, "samples").parts())
        if tasks:
            log.write("end", done=len(tasks) - len(undone), undone=len(undone))
    there = [n for n in numbers if n not in undone]
    total, worked = Counter[str](), 0
    for receipt in accounted(job, there):
        total.update({k: getattr(receipt, k) for k in _SUMS})
        worked += receipt.units if receipt.part in sizes else 0
    return Summary(
        output=str(output),
        done=len(tasks) - len(undone),
        kept=len(numbers) - len(tasks),
        stale=len(left.stale),
        gone=len(left.gone),
        undone=undone,
        seconds=time.monotonic() - begun,
        worked=worked,
        reasons=reasons(job, there) if total["failed"] else [],
        skips=reasons(job, there, "skipped") if total["skipped"] else [],
        left=len(set(output.missing()) - set(numbers)),
        notes=parts.notes(job, there) if tasks else [],
        noun=job.declared.noun,
        **{k: total[k] for k in _SUMS},
    )


def _watched(
    job: Job,
    description: Description,
    tasks: list[Task],
    engine: EngineOptions,
    shown: Bar,
    sizes: dict[int, int],
    max_failures: float | int | None,
) -> Any:
    """The engine's results, held against the limits of a run, while the bar moves.

    The bar follows what steps report, and each part's end.
    """
    reported, finished, total = 0, 0, sum(sizes[task.number] for task in tasks)

    def on_rows(rows: int) -> None:
        nonlocal reported
        # What a worker says late is counted already, with the end of its part.
        rows = min(rows, total - reported)
        reported += rows
        shown.update(rows)

    if not tasks:
        return
    output = job.table(job.output)
    left = {task.number for task in tasks}
    ended: list[int] = []
    failing: list[int] = []
    failed = seen = 0
    limits.check_space(job, output.parts(), left)
    for result in dispatch.run(job, description, tasks, engine, on_rows):
        left.discard(result.number)
        finished += sizes[result.number]
        if reported < finished:
            on_rows(finished - reported)
        yield result
        if result.receipt is not None:
            ended.append(result.number)
            if result.receipt.failed:
                failing.append(result.number)
            failed += result.receipt.failed
            seen += result.receipt.ok + result.receipt.failed
            limits.check_failures(failed, seen, max_failures, lambda: reasons(job, failing))
            if len(ended) & (len(ended) - 1) == 0:  # the 1st, 2nd, 4th, 8th ...: cheap, and early
                limits.check_space(job, ended, left)


def _log_result(log: RunLog, result: Result, rows: int) -> None:
    what: dict[str, Any] = {"part": result.number, "worker": result.worker}
    what |= {n: round(getattr(result, n), 3) for n in ("seconds", "cpu_seconds")}
    if result.receipt is None:
        log.write("undone", **what, error=str(result.error), trace=result.trace)
    else:
        counts = {k: getattr(result.receipt, k) for k in _SUMS[1:]}
        log.write("part", **what, rows=rows, **counts)


def _reason(result: Result, undone: dict[int, str], log: RunLog) -> str:
    """Why a part stays undone; raises what ends the run."""
    error = result.error
    if isinstance(error, RsaDataError) and not isinstance(error, TransientError):
        raise error
    if result.trace:
        unexpected = sum(why.endswith(_SEE) for why in undone.values()) + 1
        if unexpected >= _UNEXPECTED:
            raise RsaDataError(
                f"{unexpected} parts ended in unexpected errors; part {result.number}: {error}. "
                f"The tracebacks are in {log.store.location}/{log.path}"
            ) from error
        return f"{error}{_SEE}"
    return str(error)


_SEE = " (unexpected; the traceback is in the log)"
