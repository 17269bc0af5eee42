"""The Ray worker pool: actors on one machine or many, fed one part at a time.

Ray only places and restarts; parts, receipts and retries are those of every engine. Ray Data is
not used: rows here are part numbers, whose order and fate must be known.
"""

import os
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...common.errors import RsaDataError
from ...common.extras import extras
from ...store.tables import Description
from ..jobs import Job
from . import ray_cluster
from .pool import EngineOptions, Task, WorkerEvent, attempt, portable


class Actors:
    """Stateful actors, each with the stage's model loaded once.

    On a cluster every node must have this version of rsa-data, and see the work dir and the
    dataset's root under the same path (or both in S3). Workers go to the command's folder, against
    which relative paths such as that of `files:DIR` are meant.
    """

    def __init__(self, job: Job, description: Description, options: EngineOptions):
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        with extras("--engine ray"):
            import ray as package
        ray: Any = package
        self.ray = ray
        self.joined = not ray.is_initialized()
        if self.joined:
            ray_cluster.connect(ray, job, options)
        takes = ray_cluster.size(job, ray.nodes(), options.workers)
        if "GPU" not in takes and job.options.get("device") == "auto":
            # A node with a GPU may join later, and Ray hides GPUs only from those that have some.
            job = replace(job, options={**job.options, "device": "cpu"})
        self.given = (_absolute(job), description, options.memory, str(Path.cwd()))
        self.watch = ray_cluster.Watch(ray, takes, self.joined and options.ray_address is None)
        actor: dict[str, Any] = {"max_restarts": 0, "max_task_retries": 0}
        if options.memory is not None:
            # Only then: beside a group, Ray no longer runs a worker's parts in its main thread.
            actor["concurrency_groups"] = {_BESIDE: 1}
        self.actor: Any = ray.remote(num_cpus=takes["CPU"], num_gpus=takes.get("GPU", 0), **actor)(
            _Worker
        )
        self.doing: dict[Any, Any] = {}  # what is awaited -> the actor that does it
        self.actors: set[Any] = set()
        self.working: set[Any] = set()

    def start(self) -> Any:
        actor = self.actor.remote(*self.given)
        self.doing[actor.begin.remote()] = actor
        if self.given[2] is not None:
            self.doing[actor.over_memory.options(concurrency_group=_BESIDE).remote()] = actor
        self.actors.add(actor)
        return actor

    def dispatch(self, worker: Any, task: Task) -> None:
        self.doing[worker.work.remote(task)] = worker
        self.working.add(worker)

    def events(self, seconds: float) -> list[WorkerEvent]:
        ended, _ = self.ray.wait(list(self.doing), timeout=seconds)
        self.watch.check(bool(self.working))
        return [self._ended(reference) for reference in ended]

    def stop(self) -> None:
        self.watch.stop()
        for actor in self.actors:
            self.ray.kill(actor)
        if self.joined:
            ray_cluster.leave(self.ray)

    def _ended(self, reference: Any) -> WorkerEvent:
        worker = self.doing.pop(reference)
        try:
            kind, value = self.ray.get(reference)
        except self.ray.exceptions.RayError as error:
            kind, value = "died", _why(error)
        if kind in ("died", "result"):
            self.working.discard(worker)
        if kind == "died":
            self.actors.discard(worker)
            self.doing = {waited: by for waited, by in self.doing.items() if by != worker}
            self.ray.kill(worker)
        return WorkerEvent(worker, kind, value)


# The name of the calls that run beside a worker's parts.
_BESIDE = "beside"

# A worker over its memory ends itself after so long, in seconds, if nobody else does.
_GRACE = 2.0


def _why(error: Exception) -> str:
    """What Ray knows of a death, in a sentence: the one with its reason, or its first."""
    lines = str(error).strip().split("\n")
    reason = next((line for line in lines if " because " in line), lines[0])
    return f"ended: {type(error).__name__}: {reason.partition('. ')[0].rstrip('.')}"


class _Worker:
    """Runs in an actor's process."""

    def __init__(self, job: Job, description: Description, memory: int | None, folder: str):
        self.given = (job, description, memory)
        self.folder = folder

    def begin(self) -> tuple[str, Any]:
        """Loads what the stage needs. Not in __init__, whose errors Ray reports as a death."""
        from ...common import pandas_later
        from .. import parts

        pandas_later.install()
        job, description, _ = self.given
        try:
            _enter(self.folder, job)
            self.step = parts.build_step(job, description)
        except Exception as error:
            return "broken", portable(error)
        return "ready", None

    def work(self, task: Task) -> tuple[str, Any]:
        job, description, _ = self.given
        return "result", attempt(job, self.step, description, task)

    def over_memory(self) -> tuple[str, Any]:
        """Ends when this process holds too much: Ray reports no exit status."""
        from . import local

        most = self.given[-1]
        assert most is not None
        try:
            while local.anonymous_bytes() <= most:
                time.sleep(0.05)
        except Exception as error:
            return "broken", portable(error)
        threading.Timer(_GRACE, os._exit, (1,)).start()
        return "died", local.held_more(most)


def _enter(folder: str, job: Job) -> None:
    """Goes to the command's folder; RsaDataError where it is not there, but may be needed."""
    try:
        os.chdir(folder)
    except OSError as error:
        for value in job.options.values():
            _, colon, rest = str(value).rpartition(":")
            # A name on a hub, hf:OWNER/NAME, is none of a file as long as there is none here.
            if colon and rest and not Path(rest).is_absolute() and Path(rest).exists():
                raise RsaDataError(
                    f"{value}: this node has no folder {folder}, in which the command was given, "
                    f"but another {rest} where Ray was started: give an absolute path"
                ) from error


def _absolute(job: Job) -> Job:
    """The job with paths that do not depend on the folder a worker starts in."""
    options = {
        name: value.absolute() if isinstance(value, Path) else value
        for name, value in job.options.items()
    }
    work = job.work if "://" in job.work else str(Path(job.work).absolute())
    root = str(Path(job.root).absolute()) if job.root and "://" not in job.root else job.root
    return replace(job, work=work, options=options, root=root)
