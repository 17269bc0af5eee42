"""One run of a row stage over one dataset: what is to do, doing it, and what came of it."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import pyarrow.compute as pc

from . import engines, stages
from .errors import RsaDataError, TransientError, UsageError
from .parts import Work
from .stages import Job


class Bar(Protocol):
    """What shows progress: tqdm, or plain lines."""

    def update(self, rows: int) -> Any:
        """Says that this many more rows are done."""

    def close(self) -> None:
        """No more is to come."""


@dataclass(frozen=True)
class Summary:
    """What a run did and what the table holds now.

    done : parts made in this run; kept : parts that were there; stale : of the parts made, those
        made again because their input had changed; undone : parts left for a later run, with why.
    rows, ok, failed, skipped, bytes : of the selected parts. seconds : of this run.
    worked : input rows that this run went through, for the rate.
    """

    output: str
    done: int
    kept: int
    stale: int
    undone: dict[int, str]
    rows: int
    ok: int
    failed: int
    skipped: int
    bytes: int
    seconds: float
    worked: int
    reasons: list[tuple[str, int]]


def run(
    job: Job,
    *,
    split: str | None = None,
    part_range: tuple[int, int] | None = None,
    workers: int = 1,
    start_over: bool = False,
    redo_failed: bool = False,
    bar: Callable[[str, int], Bar],
) -> Summary:
    """Brings the job's output up to date for the selected parts.

    part_range : first and last part, last excluded. redo_failed : also parts with failed rows.
    bar : (title, total rows) -> something that shows progress.
    """
    begun = time.monotonic()
    work, output = Work(job.work), job.table(job.output)
    if start_over:
        output.start_over()
    numbers = select(work, job.dataset, split, part_range)
    for name in job.inputs:
        if missing := sorted(set(numbers) - set(job.table(name).parts())):
            first = ", ".join(map(str, missing[:5])) + (" ..." if len(missing) > 5 else "")
            raise RsaDataError(
                f"{job.table(name)}: expected parts of this table first; {len(missing)} are not "
                f"done: {first}. Run `rsa-data status` to see what to run"
            )
    description = stages.describe(job)
    output.bind(description)
    stages.remember(job)
    todo, stale = stages.pending(job, description, numbers)
    if redo_failed:
        again = [n for n in numbers if n not in todo and output.receipt(n)["failed"]]
        todo = sorted(todo + again)
    sizes = {n: _units(job.table(job.inputs[0]).receipt(n)) for n in todo}
    undone: dict[int, str] = {}
    shown = bar(f"{job.dataset} {job.stage}", sum(sizes.values()))
    try:
        for number, result in _ticking(job, description, todo, workers, shown, sizes):
            if isinstance(result, TransientError):
                undone[number] = str(result)
    finally:
        shown.close()
    output.manifest(work.table(job.dataset, "samples").parts())
    receipts = [output.receipt(n) for n in numbers if n not in undone]
    total = {k: sum(r[k] for r in receipts) for k in ("rows", "ok", "failed", "skipped", "bytes")}
    return Summary(
        output=str(output),
        done=len(todo) - len(undone),
        kept=len(numbers) - len(todo),
        stale=len(stale),
        undone=undone,
        seconds=time.monotonic() - begun,
        worked=sum(size for n, size in sizes.items() if n not in undone),
        reasons=reasons(job, [n for n in numbers if n not in undone]) if total["failed"] else [],
        **total,
    )


def _ticking(
    job: Job,
    description: dict[str, Any],
    todo: list[int],
    workers: int,
    shown: Bar,
    sizes: dict[int, int],
) -> Any:
    """The engine's results; the bar moves with what steps report, and at each part's end."""
    reported = 0
    finished = 0

    def on_rows(rows: int) -> None:
        nonlocal reported
        reported += rows
        shown.update(rows)

    if not todo:
        return
    for number, result in engines.run(job, description, todo, workers=workers, on_rows=on_rows):
        finished += sizes[number]
        if reported < finished:
            on_rows(finished - reported)
        yield number, result


def _units(receipt: dict[str, Any]) -> int:
    return receipt["ok"] + receipt["failed"] + receipt["skipped"]


def select(
    work: Work, dataset: str, split: str | None, part_range: tuple[int, int] | None
) -> list[int]:
    """Part numbers of a dataset, of one split and range if asked for."""
    samples = work.table(dataset, "samples")
    numbers = samples.parts()
    if split is not None:
        splits = {n: samples.receipt(n)["split"] for n in numbers}
        if split not in splits.values():
            raise UsageError(
                f"{dataset}: no split {split!r}; there are: {', '.join(sorted({*splits.values()}))}"
            )
        numbers = [n for n in numbers if splits[n] == split]
    if part_range is not None:
        numbers = [n for n in numbers if part_range[0] <= n < part_range[1]]
    return numbers


def reasons(job: Job, numbers: list[int], most: int = 3) -> list[tuple[str, int]]:
    """The most frequent reasons of failed rows, with how often each occurs."""
    counts: dict[str, int] = {}
    table = job.table(job.output)
    for number in numbers:
        if not table.receipt(number)["failed"]:
            continue
        part = table.read(number, columns=["status", "error"])
        errors = part.filter(pc.equal(part["status"], "failed"))["error"]
        for pair in pc.value_counts(errors.combine_chunks()).to_pylist():
            counts[pair["values"]] = counts.get(pair["values"], 0) + pair["counts"]
    return sorted(counts.items(), key=lambda pair: (-pair[1], pair[0]))[:most]
