"""What an engine is made of: a pool of workers, the tasks they get and the events they send.

A worker pool starts workers, gives each one part at a time and reports what happens to them: local
processes (`local.py`) or Ray actors (`ray.py`). `dispatch.py` drives any of them.
"""

import os
import pickle
import socket
import time
import traceback
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from ...common.errors import RsaDataError, TransientError
from ...store.tables import Description, Receipt
from .. import parts
from ..jobs import Job
from ..stage import Step


@dataclass(frozen=True)
class EngineOptions:
    """Which engine runs the parts; nothing here changes what comes out.

    engine : an entry of `registry.ENGINES`. workers : processes side by side. memory : bytes that a
    worker may hold, None for no limit. ray_address : of a running cluster, None to start one on
    this machine.
    """

    engine: str = "local"
    workers: int = 1
    memory: int | None = None
    ray_address: str | None = None


@dataclass(frozen=True)
class Task:
    """One part to do; redo : even if it is there with the same fingerprint."""

    number: int
    redo: bool = False


@dataclass(frozen=True)
class Result:
    """What became of a part: its receipt, or the error that left it undone.

    seconds : that its worker took. cpu_seconds : that its worker computed, on all its threads.
    worker : host and process. trace : of an unexpected error.
    """

    number: int
    receipt: Receipt | None
    error: Exception | None = None
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    worker: str = ""
    trace: str = ""


@dataclass(frozen=True)
class WorkerEvent:
    """What happened to a worker.

    kind : ready (it waits for a part), rows (it has done `value` more), result (value : Result),
        broken (it cannot begin; value : the error), died (value : why, as far as it is known).
    """

    worker: Any
    kind: Literal["ready", "rows", "result", "broken", "died"]
    value: Any = None


class WorkerPool(Protocol):
    """Workers of one kind. Made with (job, description, options)."""

    def start(self) -> Any:
        """Starts one more worker and returns what stands for it."""

    def dispatch(self, worker: Any, task: Task) -> None:
        """Gives a part to a worker."""

    def events(self, seconds: float) -> list[WorkerEvent]:
        """What happened, after at most so many seconds; raises RsaDataError when nothing can."""

    def stop(self) -> None:
        """Ends all workers, whatever they do."""


def attempt(job: Job, step: Step, description: Description, task: Task) -> Result:
    """One part, in the process of a worker: commits it, or says why it stays undone."""
    begun, computed = time.monotonic(), time.process_time()
    receipt = None
    error: Exception | None = None
    trace = ""
    try:
        receipt = parts.run_part(job, step, description, task.number, redo=task.redo)
    except RsaDataError as known:
        error = portable(known)
    except MemoryError:
        error = TransientError("out of memory; use fewer --workers")
    except OSError as failed:
        error = TransientError(f"{type(failed).__name__}: {failed}")
    except Exception as unexpected:
        error = RuntimeError(f"{type(unexpected).__name__}: {unexpected}")
        trace = traceback.format_exc()
    return Result(
        task.number,
        receipt,
        error,
        seconds=time.monotonic() - begun,
        cpu_seconds=time.process_time() - computed,
        worker=f"{socket.gethostname()}:{os.getpid()}",
        trace=trace,
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
