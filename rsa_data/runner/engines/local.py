"""The local worker pool: processes of this machine, each with a pipe of its own."""

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from ...common import pandas_later, progress
from ...common.errors import RsaDataError
from ...store.tables import Description
from .. import parts
from ..jobs import Job
from .pool import EngineOptions, Task, WorkerEvent, attempt, portable

# Exit status of a worker that held more memory than it may.
_TOO_MUCH = 117

# s that workers have to end when they are told to, all together.
_END_WITHIN = 2.0


class Processes:
    """Spawned processes: threads of torch and ONNX Runtime do not survive a fork.

    A pipe for each: a lock that all share would be held for ever by a worker killed at the wrong
    moment.
    """

    def __init__(self, job: Job, description: Description, options: EngineOptions):
        self.given = (job, description, options.memory)
        self.memory = options.memory
        if options.memory is not None:
            anonymous_bytes()  # says so at once where memory cannot be measured
        self.context = multiprocessing.get_context("spawn")
        self.processes: dict[Connection, Any] = {}

    def start(self) -> Connection:
        ours, theirs = self.context.Pipe()
        process = self.context.Process(target=_work, args=(theirs, *self.given), daemon=True)
        with _without_interrupts():
            process.start()
        theirs.close()
        self.processes[ours] = process
        return ours

    def dispatch(self, worker: Connection, task: Task) -> None:
        with contextlib.suppress(OSError):  # it died just now: `events` will say so
            worker.send(task)

    def events(self, seconds: float) -> list[WorkerEvent]:
        found = []
        for worker in wait(list(self.processes), seconds):
            assert isinstance(worker, Connection)
            try:
                kind, value = worker.recv()
                found.append(WorkerEvent(worker, kind, value))
            except (EOFError, OSError, pickle.UnpicklingError):
                found.append(WorkerEvent(worker, "died", self._end(worker)))
        return found

    def stop(self) -> None:
        for worker, process in self.processes.items():
            # Whatever it has half done is in a temporary file, which goes with the next sweep.
            process.terminate()
            worker.close()
        deadline = time.monotonic() + _END_WITHIN
        for process in self.processes.values():
            process.join(max(0.0, deadline - time.monotonic()))
            if process.exitcode is None:
                process.kill()
                process.join()
        self.processes.clear()

    def _end(self, worker: Connection) -> str:
        process = self.processes.pop(worker)
        worker.close()
        process.join(5)
        if process.exitcode is None:
            process.kill()
            process.join()
        if process.exitcode == _TOO_MUCH:
            return held_more(self.memory or 0)
        if process.exitcode < 0:
            killed = signal.Signals(-process.exitcode).name
            return f"was ended by {killed}" + (" (out of memory?)" if killed == "SIGKILL" else "")
        return f"ended with exit status {process.exitcode}"


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
    """What is spawned inside ignores Ctrl-C from its first moment: the parent ends it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _work(pipe: Connection, job: Job, description: Description, memory: int | None) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    pandas_later.install()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if memory is not None:
        threading.Thread(target=limit_memory, args=(memory,), daemon=True).start()
    lock = threading.Lock()

    def send(kind: str, value: Any = None) -> None:
        with lock, contextlib.suppress(BrokenPipeError):
            pipe.send((kind, value))

    progress.listen(_now_and_then(lambda rows: send("rows", rows)))
    try:
        step = parts.build_step(job, description)
    except Exception as error:
        send("broken", portable(error))
        return
    send("ready")
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        send("result", attempt(job, step, description, task))


def _now_and_then(send: Callable[[int], None], seconds: float = 0.2) -> Callable[[int], None]:
    """Collects rows so that fast steps do not fill the pipe."""
    collected, last = 0, 0.0

    def count(rows: int) -> None:
        nonlocal collected, last
        collected += rows
        if time.monotonic() - last >= seconds:
            send(collected)
            collected, last = 0, time.monotonic()

    return count


def limit_memory(most: int) -> None:
    """Ends this process as soon as it holds more bytes of its own than `most`.

    Counted are pages that are really there and no file's (RssAnon of proc(5)): limits on address
    space count what ONNX Runtime and torch only reserve.
    """
    while True:
        if anonymous_bytes() > most:
            os._exit(_TOO_MUCH)
        time.sleep(0.05)


def held_more(most: int) -> str:
    """Why a worker was ended that held more than `most` bytes."""
    return f"held more than the {most:,} bytes of --memory-limit"


def anonymous_bytes() -> int:
    """Memory of this process that no file backs, in bytes; Linux only."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("RssAnon:"):
            return int(line.split()[1]) * 1024
    raise RsaDataError("--memory-limit needs Linux: /proc/self/status has no RssAnon here")


def _end_with_parent() -> None:
    """A worker whose parent was killed must not go on alone or hang."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
