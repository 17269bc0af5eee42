"""The loop that all engines share: dispatches the parts and yields what became of each.

A part whose worker died goes to another one, a bounded number of times; a part that takes far
longer than all others goes to an idle worker as well.
"""

import logging
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from ... import registry
from ...common import progress
from ...common.errors import RsaDataError, TransientError
from ...store.tables import Description
from .. import parts
from ..jobs import Job
from .pool import EngineOptions, Result, Task, WorkerPool, attempt

# A part whose worker died is tried this often: one death may have another cause than the part.
ATTEMPTS = 3

# A part that takes so many times as long as the longest one before it, and so many seconds, is
# given to a second worker that has nothing else to do.
LATE_TIMES, LATE_AFTER = 10, 600.0

_log = logging.getLogger(__name__)

MakePool = Callable[[Job, Description, EngineOptions], WorkerPool]


def run(
    job: Job,
    description: Description,
    tasks: list[Task],
    options: EngineOptions,
    on_rows: Callable[[int], None] | None = None,
    make_pool: MakePool | None = None,
) -> Iterator[Result]:
    """Runs the parts and yields what became of each.

    on_rows : called with the number of input rows done, now and then, in this process.
    make_pool : makes the worker pool, instead of the entry of `registry.ENGINES`.

    Raises RsaDataError when the run as a whole cannot go on. Parts that were committed stay so
    whatever happens.
    """
    few = options.workers <= 1 or len(tasks) <= 1
    if make_pool is None and options.engine == "local" and options.memory is None and few:
        progress.listen(on_rows)
        try:
            step = parts.build_step(job, description)
            for task in tasks:
                yield attempt(job, step, description, task)
        finally:
            progress.listen(None)
        return
    options = replace(options, workers=max(1, min(options.workers, len(tasks))))
    if make_pool is None and options.engine == "local":
        _say_of_cores(job, options.workers)
    make: MakePool = make_pool or registry.resolve("engine", registry.ENGINES, options.engine)
    pool = make(job, description, options)
    try:
        yield from _dispatch(pool, tasks, options.workers, on_rows or (lambda rows: None))
    finally:
        pool.stop()


def _say_of_cores(job: Job, workers: int) -> None:
    """Says when workers want more CPUs than this machine has: they wait for each other then."""
    threads = job.options.get("threads") or 1
    affinity = getattr(os, "sched_getaffinity", None)
    there = len(affinity(0)) if affinity else os.cpu_count() or 1
    fit = max(1, there // threads)
    if workers > fit:
        progress.notice(
            f"--workers {workers} with {threads} thread(s) each on {there} CPU(s): --workers {fit} "
            "is about as fast"
        )


def _dispatch(
    pool: WorkerPool, tasks: list[Task], workers: int, on_rows: Callable[[int], None]
) -> Iterator[Result]:
    """Gives out the parts until each has ended."""
    queue, busy = deque(tasks), dict[Any, Task]()
    left, idle = {task.number for task in tasks}, list[Any]()
    begun, longest = dict[Any, float](), 0.0
    deaths, in_a_row = Counter[int](), 0
    for _ in range(workers):
        pool.start()
    while left:
        for event in pool.events(1.0):
            if event.kind == "broken":
                raise event.value
            if event.kind == "rows":
                on_rows(event.value)
            elif event.kind == "ready":
                idle.append(event.worker)
            elif event.kind == "result":
                busy.pop(event.worker)
                idle.append(event.worker)
                in_a_row, longest = 0, max(longest, event.value.seconds)
                if event.value.number in left:
                    left.remove(event.value.number)
                    yield event.value
            else:
                in_a_row += 1
                if event.worker in idle:
                    idle.remove(event.worker)
                if in_a_row > ATTEMPTS * workers:
                    raise RsaDataError(
                        f"{in_a_row} workers died one after the other; the last one {event.value}. "
                        "Finished parts are kept: run the same command again, with fewer --workers "
                        "if memory was short"
                    )
                task = busy.pop(event.worker, None)
                if task is not None and task.number in left and task not in busy.values():
                    deaths[task.number] += 1
                    if deaths[task.number] < ATTEMPTS:
                        queue.append(task)
                    else:
                        left.remove(task.number)
                        why = f"its worker died {ATTEMPTS} times; the last one {event.value}"
                        yield Result(task.number, None, TransientError(why))
                if queue:
                    pool.start()
            while queue and idle:
                worker, task = idle.pop(), queue.popleft()
                busy[worker], begun[worker] = task, time.monotonic()
                pool.dispatch(worker, task)
        # A worker that hangs sends no event: its part is given to an idle one as well, and what is
        # committed first stays.
        patience = max(LATE_AFTER, LATE_TIMES * longest)
        for slow in [w for w in busy if idle and time.monotonic() - begun[w] > patience]:
            if idle and list(busy.values()).count(busy[slow]) == 1 and busy[slow].number in left:
                worker = idle.pop()
                busy[worker], begun[worker] = busy[slow], time.monotonic()
                _log.warning("part %d takes long: dispatched to a second worker", busy[slow].number)
                pool.dispatch(worker, busy[slow])
