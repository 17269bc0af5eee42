"""The Ray crew: actors on one machine or many, fed one part at a time.

Ray only places and restarts; parts, receipts and retries are those of every engine. Ray Data is
not used: rows here are part numbers, whose order and fate must be known.
"""

import logging
import os
import signal
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..errors import RsaDataError
from ..registry import extras
from ..stages import Job
from . import How, News, Task, attempt, portable

# A cluster that has begun no worker after so long, in seconds, never will: it lacks what they ask
# for. Enough for nodes that are started on demand.
_BEGIN_WITHIN = float(os.environ.get("RSA_DATA_RAY_BEGIN_WITHIN", 900))


class Actors:
    """Stateful actors, each with the stage's model loaded once.

    On a cluster every node must have this version of rsa-data, and see the work dir and the
    dataset's root under the same path (or both in S3).
    """

    def __init__(self, job: Job, description: dict[str, Any], how: How):
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        with extras("--engine ray"):
            import ray
        self.ray = ray
        self.given = (_absolute(job), description, how.memory)
        self.began_cluster = not ray.is_initialized()
        if self.began_cluster:
            _connect(ray, how)
        gpus = 1 if str(job.options.get("device", "")).startswith("cuda") else 0
        self.actor: Any = ray.remote(_Worker)
        self.actor = self.actor.options(
            num_cpus=1, num_gpus=gpus, max_restarts=0, max_task_retries=0
        )
        self.doing: dict[Any, Any] = {}  # what is awaited -> the actor that does it
        self.actors: set[Any] = set()
        self.begun, self.ready = time.monotonic(), False

    def start(self) -> Any:
        actor = self.actor.remote(*self.given)
        self.doing[actor.begin.remote()] = actor
        self.actors.add(actor)
        return actor

    def give(self, worker: Any, task: Task) -> None:
        self.doing[worker.work.remote(task)] = worker

    def news(self, seconds: float) -> list[News]:
        ended, _ = self.ray.wait(list(self.doing), timeout=seconds)
        if not ended and not self.ready and time.monotonic() - self.begun > _BEGIN_WITHIN:
            raise RsaDataError(
                f"--engine ray: no worker has begun within {_BEGIN_WITHIN:.0f} s. The cluster has "
                f"{self.ray.cluster_resources()}; is what a worker needs there, and free?"
            )
        return [self._ended(reference) for reference in ended]

    def stop(self) -> None:
        for actor in self.actors:
            self.ray.kill(actor)
        if self.began_cluster:
            self.ray.shutdown()

    def _ended(self, reference: Any) -> News:
        worker = self.doing.pop(reference)
        try:
            kind, value = self.ray.get(reference)
        except self.ray.exceptions.RayError as error:
            self.actors.discard(worker)
            why = str(error).strip().partition("\n")[0]
            return News(worker, "died", f"said: {type(error).__name__}: {why}")
        self.ready = True
        return News(worker, kind, value)


class _Worker:
    """Runs in an actor's process."""

    def __init__(self, job: Job, description: dict[str, Any], memory: int | None):
        self.given = (job, description, memory)

    def begin(self) -> tuple[str, Any]:
        """Loads what the stage needs. Not in __init__, whose errors Ray tells as a death."""
        from .. import steps
        from .local import limit_memory

        job, _, memory = self.given
        if memory is not None:
            threading.Thread(target=limit_memory, args=(memory,), daemon=True).start()
        try:
            self.step = steps.build_step(job)
        except Exception as error:
            return "broken", portable(error)
        return "ready", None

    def work(self, task: Task) -> tuple[str, Any]:
        job, description, _ = self.given
        return "result", attempt(job, self.step, description, task)


def _connect(ray: Any, how: How) -> None:
    quiet = {"logging_level": logging.ERROR, "log_to_driver": False}
    main = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGTERM)
    try:
        if how.ray_address is None:
            ray.init(num_cpus=max(1, how.workers), include_dashboard=False, **quiet)
        else:
            ray.init(address=how.ray_address, **quiet)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise RsaDataError(
            f"--ray-address {how.ray_address}: cannot reach a Ray cluster there: {error}. Leave it "
            "out to run on this machine alone"
        ) from error
    finally:
        # Ray ends the process with its own exit status on SIGTERM; a command has its own way.
        if main:
            signal.signal(signal.SIGTERM, before)


def _absolute(job: Job) -> Job:
    """The job with paths that do not depend on the folder a worker starts in."""
    options = {
        name: value.absolute() if isinstance(value, Path) else value
        for name, value in job.options.items()
    }
    work = job.work if "://" in job.work else str(Path(job.work).absolute())
    root = str(Path(job.root).absolute()) if job.root and "://" not in job.root else job.root
    return replace(job, work=work, options=options, root=root)
