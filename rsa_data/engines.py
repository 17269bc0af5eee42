"""Engines: who runs which part where. The loop is the same for all, and so is the commit.

An engine takes the numbers of the parts to do and yields (number, receipt or error) as they end.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait as wait_for_process
from typing import Any

from . import progress, stages
from .errors import RsaDataError, TransientError
from .stages import Job

Result = tuple[int, dict[str, Any] | TransientError]


def run(
    job: Job,
    description: dict[str, Any],
    numbers: list[int],
    *,
    workers: int = 1,
    on_rows: Callable[[int], None] | None = None,
) -> Iterator[Result]:
    """Runs the parts in this process, or in `workers` of them.

    on_rows : called with the number of input rows done, now and then, in this process.
    Yields a part's receipt, or the TransientError that left it undone; any other error ends the
    run. Parts that were committed stay so whatever happens.
    """
    if workers <= 1 or len(numbers) <= 1:
        progress.listen(on_rows)
        try:
            step = stages.build_step(job)
            for number in numbers:
                yield number, _attempt(job, step, description, number)
        finally:
            progress.listen(None)
    else:
        yield from _run_in_processes(job, description, numbers, workers, on_rows)


def _attempt(
    job: Job, step: stages.Step, description: dict[str, Any], number: int
) -> dict[str, Any] | TransientError:
    try:
        return stages.run_part(job, step, description, number)
    except TransientError as error:
        return error


def _run_in_processes(
    job: Job,
    description: dict[str, Any],
    numbers: list[int],
    workers: int,
    on_rows: Callable[[int], None] | None,
) -> Iterator[Result]:
    # Spawned, not forked: threads of torch and ONNX Runtime do not survive a fork.
    context = multiprocessing.get_context("spawn")
    rows = context.Value("q", 0)
    shown = 0
    pool = ProcessPoolExecutor(
        min(workers, len(numbers)), context, _start_worker, (job, description, rows)
    )
    running = {pool.submit(_work, number): number for number in numbers}
    try:
        while running:
            done, _ = wait(running, timeout=0.2, return_when=FIRST_COMPLETED)
            if on_rows and rows.value != shown:
                on_rows(rows.value - shown)
                shown = rows.value
            for future in done:
                number = running.pop(future)
                yield number, future.result()
    except BrokenProcessPool as error:
        raise RsaDataError(
            f"{job.dataset}/{job.output}: a worker process ended without a word (killed, or out of "
            "memory). Finished parts are kept: run the same command again, with fewer --workers "
            "if memory was short"
        ) from error
    finally:
        # Whatever a worker has half done is in a temporary file, which the next run removes.
        for process in list((pool._processes or {}).values()):
            with contextlib.suppress(Exception):
                process.terminate() if running else None
        pool.shutdown(wait=True, cancel_futures=True)


_worker: tuple[Job, stages.Step, dict[str, Any]] | None = None


def _start_worker(job: Job, description: dict[str, Any], rows: Any) -> None:
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()

    def count(done: int) -> None:
        with rows.get_lock():
            rows.value += done

    progress.listen(count)
    _worker = (job, stages.build_step(job), description)


def _end_with_parent() -> None:
    """A worker whose parent was killed must not go on alone or hang."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for_process([parent.sentinel])
        os._exit(1)


def _work(number: int) -> dict[str, Any] | TransientError:
    assert _worker is not None
    job, step, description = _worker
    return _attempt(job, step, description, number)
