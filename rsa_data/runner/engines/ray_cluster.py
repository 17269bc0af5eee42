"""A Ray cluster as the worker pool needs it: joined quietly, watched, left without a hang.

Ray itself waits for ever for what can no longer come: actors that fit no node that is left, answers
of this machine's node after its death, a head that is frozen or cut off.
"""

import atexit
import logging
import math
import os
import signal
import sys
import threading
import time
from collections import Counter
from typing import Any

from ...common.errors import RsaDataError
from ...common.progress import notice
from ..jobs import Job
from .pool import EngineOptions

# A cluster on which no worker has been at work for so long, in seconds, will not have one any more.
# Enough for nodes that are started on demand.
BEGIN_WITHIN = float(os.environ.get("RSA_DATA_RAY_BEGIN_WITHIN", 900))

# The head may be gone for so long, in seconds: it can be restarted. After 60 s without it Ray ends
# this process in its own way (gcs_rpc_server_reconnect_timeout_s), without a word of ours.
HEAD_WITHIN = 40.0

# Between looks at the nodes, and the longest wait for Ray's own end, in seconds.
EVERY, _LEAVE_WITHIN = 2.0, 10.0

_log = logging.getLogger(__name__)


def size(job: Job, nodes: list[dict[str, Any]], workers: int) -> dict[str, float]:
    """What one worker takes: {"CPU": its threads, "GPU": a GPU or a share of one, where used}.

    nodes : as `ray.nodes()` gives them. `auto` takes GPUs when the cluster has any, for all workers
    alike: on a mixture of CPUs and GPUs the bytes would follow from who came first. Each worker has
    a GPU of its own as long as there are as many; more workers share them evenly.
    """
    takes = {"CPU": float(cpus(job))}
    there = sum(node["Resources"].get("GPU", 0.0) for node in nodes if node["Alive"])
    device = str(job.options.get("device", "cpu"))
    if device.startswith("cuda") or (device == "auto" and there):
        takes["GPU"] = 1 / max(1, math.ceil(workers / there)) if there else 1.0
    return takes


def cpus(job: Job) -> int:
    """CPUs that one worker keeps busy: the stage's `threads`, 1 for a stage that has no such."""
    return max(1, job.options.get("threads") or 1)


def connect(ray: Any, job: Job, options: EngineOptions) -> None:
    """Joins the cluster at the address, or starts one on this machine with room for all."""
    quiet = {"logging_level": logging.ERROR, "log_to_driver": False}
    main = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGTERM)
    _without_chatter()
    try:
        if options.ray_address is None:
            # "local": without it a cluster that happens to run on this machine would be joined.
            room = max(1, options.workers) * cpus(job)
            ray.init(address="local", num_cpus=room, include_dashboard=False, **quiet)
        else:
            ray.init(address=options.ray_address, **quiet)
    except (ConnectionError, RuntimeError, ValueError) as error:
        if options.ray_address is None:
            raise RsaDataError(f"--engine ray: Ray does not start here: {error}") from error
        raise RsaDataError(
            f"--ray-address {options.ray_address}: cannot reach a Ray cluster there: {error}. "
            "Leave it out to run on this machine alone"
        ) from error
    finally:
        # Ray ends the process with its own exit status on SIGTERM; a command has its own way.
        if main:
            signal.signal(signal.SIGTERM, before)


def leave(ray: Any) -> None:
    """Leaves the cluster, or gives up: Ray waits for ever for a head that is frozen or cut off."""
    thread = threading.Thread(target=ray.shutdown, daemon=True)
    thread.start()
    thread.join(_LEAVE_WITHIN)
    if thread.is_alive():
        # Ray would wait once more at the end of this process, or crash in it.
        atexit.register(_end)


def _end() -> None:
    notice(
        "The head of the Ray cluster does not answer. Finished parts are kept, but this command "
        "ends with status 1: run it again"
    )
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(1)


def _without_chatter() -> None:
    """Keeps what Ray prints of nodes and workers off standard output, which is the command's.

    Ray has no option for it; what matters of it is said here and by the worker pool.
    """
    from ray._private import worker

    if hasattr(worker, "print_to_stdstream"):
        worker.print_to_stdstream = lambda *given, **named: None


class Watch:
    """Looks at the nodes now and then, in a thread: what it asks may never be answered."""

    def __init__(self, ray: Any, takes: dict[str, float], local: bool):
        """local : the cluster was started here, for this run: no node will join it."""
        self.ray, self.takes, self.local = ray, takes, local
        self.own = ray.get_runtime_context().get_node_id()
        self.nodes: list[dict[str, Any]] = ray.nodes()
        self.answered = self.worked = time.monotonic()
        self.said = False
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._look, daemon=True)
        self.thread.start()

    def check(self, working: bool) -> None:
        """Raises RsaDataError when the run cannot go on.

        working : a worker has a part, so that the run goes on whoever else waits for room.
        """
        now = time.monotonic()
        if now - self.answered > HEAD_WITHIN:
            raise RsaDataError(
                f"--engine ray: the head of the Ray cluster has not answered for {HEAD_WITHIN:.0f} "
                "s. Finished parts are kept: run the same command again when it answers"
            )
        if any(node["NodeID"] == self.own and not node["Alive"] for node in self.nodes):
            raise RsaDataError(
                "--engine ray: Ray on this machine, over which the cluster is reached, has ended. "
                "Finished parts are kept: run the same command again when it answers"
            )
        if working:
            self.worked, self.said = now, False
            return
        waited, fits = now - self.worked, self._fits()
        within = 0.0 if self.local and not fits else BEGIN_WITHIN
        needs = f"{_words(self.takes)} on one node; the nodes have {self._have()}"
        if waited > within:
            raise RsaDataError(
                f"--engine ray: no worker could begin within {within:.0f} s. A worker takes "
                + (needs if not fits else f"{needs}, but not free")
                + ". Finished parts are kept: run the same command again on a cluster with room, "
                "or with other --device, --threads"
            )
        if not fits and not self.said and waited > 2 * EVERY:
            self.said = True
            notice(f"Waiting {within:.0f} s for a node with room: a worker takes {needs}")

    def stop(self) -> None:
        """No more looks; waits for the one that is under way, if it ends."""
        self.ended.set()
        self.thread.join(EVERY)

    def _look(self) -> None:
        while not self.ended.wait(EVERY):
            try:
                nodes = self.ray.nodes()
            except Exception:  # as good as no answer; Ray has no base class for it
                continue
            lost = _alive(self.nodes) - _alive(nodes)
            self.nodes, self.answered = nodes, time.monotonic()
            if lost:
                _log.warning(
                    "The Ray cluster has lost %d of its nodes; %d are left, which take over",
                    len(lost),
                    len(_alive(nodes)),
                )

    def _fits(self) -> bool:
        """Whether a node of the cluster, if free, has room for a worker."""
        return any(
            all(node["Resources"].get(what, 0.0) >= much for what, much in self.takes.items())
            for node in self.nodes
            if node["Alive"]
        )

    def _have(self) -> str:
        alive = [node["Resources"] for node in self.nodes if node["Alive"]]
        counts = Counter(_words({k: has.get(k, 0.0) for k in ("CPU", "GPU")}) for has in alive)
        return " / ".join(f"{count} x {words}" for words, count in counts.items()) or "nothing"


def _alive(nodes: list[dict[str, Any]]) -> set[str]:
    return {node["NodeID"] for node in nodes if node["Alive"]}


def _words(resources: dict[str, float]) -> str:
    return ", ".join(f"{much:g} {what}" for what, much in resources.items())
