"""Engines: who runs which part where. The loop is the same for all, and so is the commit.

An engine is a crew of workers: local processes, or Ray actors. The loop here gives each worker one
part after the other, gives the part of a worker that died to another one, a bounded number of
times, and yields what became of every part.
"""

import logging
import os
import pickle
import socket
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

from ... import registry
from ...common import progress
from ...common.errors import RsaDataError, TransientError
from .. import parts, stages
from ..stages import Job

# Literal NAME -> "module:crew"; the crew's parameters are those of `Crew` below.
ENGINES = {
    "local": "rsa_data.runner.engines.local:Processes",
    "ray": "rsa_data.runner.engines.ray:Actors",
}

# A part whose worker died is tried this often: once may be bad luck, thrice is the part.
ATTEMPTS = 3

# A part that takes so many times as long as the longest one before it, and so many seconds, is
# given to a second worker that has nothing else to do.
LATE_TIMES, LATE_AFTER = 10, 600.0

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class How:
    """Who does the work; nothing here changes what comes out.

    engine : local or ray. workers : processes side by side. memory : bytes that a worker may hold,
    None for no limit. ray_address : of a running cluster, None to start one on this machine.
    """

    engine: str = "local"
    workers: int = 1
    memory: int | None = None
    ray_address: str | None = None


@dataclass(frozen=True)
class Task:
    """One part to do; redo : although it is there with the same fingerprint."""

    number: int
    redo: bool = False


@dataclass(frozen=True)
class Result:
    """What became of a part: its receipt, or the error that left it undone.

    seconds : that its worker took. worker : host and process. trace : of an error nobody foresaw.
    """

    number: int
    receipt: dict[str, Any] | None
    error: Exception | None = None
    seconds: float = 0.0
    worker: str = ""
    trace: str = ""


@dataclass(frozen=True)
class News:
    """What a crew tells of a worker.

    kind : ready (it waits for a part), rows (it has done `value` more), result (value : Result),
        broken (it cannot begin; value : the error), died (value : why, as far as it is known).
    """

    worker: Any
    kind: str
    value: Any = None


class Crew(Protocol):
    """Workers of one kind. Made with (job, description, how)."""

    def start(self) -> Any:
        """Begins one more worker and returns what stands for it."""

    def give(self, worker: Any, task: Task) -> None:
        """Lets a worker do a part."""

    def news(self, seconds: float) -> list[News]:
        """What happened, after at most so many seconds; raises RsaDataError when nothing can."""

    def stop(self) -> None:
        """Ends all workers, whatever they do."""


def run(
    job: Job,
    description: dict[str, Any],
    tasks: list[Task],
    how: How,
    on_rows: Callable[[int], None] | None = None,
) -> Iterator[Result]:
    """Runs the parts and yields what became of each.

    on_rows : called with the number of input rows done, now and then, in this process.

    Raises RsaDataError when the run as a whole cannot go on. Parts that were committed stay so
    whatever happens.
    """
    if how.engine == "local" and how.memory is None and (how.workers <= 1 or len(tasks) <= 1):
        progress.listen(on_rows)
        try:
            step = parts.build_step(job)
            for task in tasks:
                yield attempt(job, step, description, task)
        finally:
            progress.listen(None)
        return
    how = replace(how, workers=max(1, min(how.workers, len(tasks))))
    crew = registry.resolve("engine", ENGINES, how.engine)(job, description, how)
    try:
        yield from _lead(crew, tasks, how.workers, on_rows or (lambda rows: None))
    finally:
        crew.stop()


def attempt(job: Job, step: stages.Step, description: dict[str, Any], task: Task) -> Result:
    """One part, in the process of a worker: commits it, or tells why it stays undone."""
    begun = time.monotonic()
    receipt, error, trace = None, None, ""
    try:
        receipt = parts.run_part(job, step, description, task.number, redo=task.redo)
    except RsaDataError as known:
        error = portable(known)
    except MemoryError:
        error = TransientError("out of memory; use fewer --workers")
    except OSError as failed:
        error = TransientError(f"{type(failed).__name__}: {failed}")
    except Exception as unforeseen:
        error = RuntimeError(f"{type(unforeseen).__name__}: {unforeseen}")
        trace = traceback.format_exc()
    seconds = time.monotonic() - begun
    return Result(
        task.number, receipt, error, seconds, f"{socket.gethostname()}:{os.getpid()}", trace
    )


def portable(error: Exception) -> Exception:
    """The error itself if it survives the way to another process, else one that says the same."""
    try:
        again = pickle.loads(pickle.dumps(error))
    except Exception:
        again = None
    if isinstance(again, type(error)) and str(again) == str(error):
        return error
    return RsaDataError(f"{type(error).__name__}: {error}")


def _lead(
    crew: Crew, tasks: list[Task], workers: int, on_rows: Callable[[int], None]
) -> Iterator[Result]:
    """Gives out the parts until each has ended."""
    queue, busy = deque(tasks), dict[Any, Task]()
    left, idle = {task.number for task in tasks}, list[Any]()
    begun, longest = dict[Any, float](), 0.0
    deaths, in_a_row = Counter[int](), 0
    for _ in range(workers):
        crew.start()
    while left:
        for news in crew.news(1.0):
            if news.kind == "broken":
                raise news.value
            if news.kind == "rows":
                on_rows(news.value)
            elif news.kind == "ready":
                idle.append(news.worker)
            elif news.kind == "result":
                busy.pop(news.worker)
                idle.append(news.worker)
                in_a_row, longest = 0, max(longest, news.value.seconds)
                if news.value.number in left:
                    left.remove(news.value.number)
                    yield news.value
            else:
                in_a_row += 1
                if news.worker in idle:
                    idle.remove(news.worker)
                if in_a_row > ATTEMPTS * workers:
                    raise RsaDataError(
                        f"{in_a_row} workers died one after the other; the last one {news.value}. "
                        "Finished parts are kept: run the same command again, with fewer --workers "
                        "if memory was short"
                    )
                task = busy.pop(news.worker, None)
                if task is not None and task.number in left and task not in busy.values():
                    deaths[task.number] += 1
                    if deaths[task.number] < ATTEMPTS:
                        queue.append(task)
                    else:
                        left.remove(task.number)
                        why = f"its worker died {ATTEMPTS} times; the last one {news.value}"
                        yield Result(task.number, None, TransientError(why))
                if queue:
                    crew.start()
            while queue and idle:
                worker, task = idle.pop(), queue.popleft()
                busy[worker], begun[worker] = task, time.monotonic()
                crew.give(worker, task)
        # A worker that hangs tells nobody: its part is given to one that has nothing to do, and
        # what is committed first stays.
        patience = max(LATE_AFTER, LATE_TIMES * longest)
        for slow in [w for w in busy if idle and time.monotonic() - begun[w] > patience]:
            if idle and list(busy.values()).count(busy[slow]) == 1 and busy[slow].number in left:
                worker = idle.pop()
                busy[worker], begun[worker] = busy[slow], time.monotonic()
                _log.warning("part %d takes long: given to a second worker", busy[slow].number)
                crew.give(worker, busy[slow])
