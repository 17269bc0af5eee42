"""A Ray cluster that loses nodes: the run goes on, or ends with an error; the bytes stay the same.

The nodes are real ones (raylets of their own) on this machine, the command is a user's.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import rooms

from rsa_data.common.errors import RsaDataError
from rsa_data.runner import jobs, runs, stages
from rsa_data.runner.engines import dispatch, ray_cluster
from rsa_data.runner.engines.pool import EngineOptions, Task
from rsa_data.store.tables import WorkDir

PARTS, ROWS, VARIANTS = 60, 500, 20
HERE = EngineOptions(workers=2)

# The command as it is typed, but for how long it waits for a cluster's head.
COMMAND = """
import sys
from rsa_data.cli import main as cli
from rsa_data.runner.engines import ray_cluster
ray_cluster.HEAD_WITHIN = 6.0
cli.main()
"""


@pytest.fixture
def cluster():
    """A head without CPUs and two nodes with two each."""
    pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    cluster = Cluster()
    memory = {"object_store_memory": 80 * 2**20}
    try:
        cluster.add_node(num_cpus=0, include_dashboard=False, **memory)
        cluster.nodes = [cluster.add_node(num_cpus=2, **memory) for _ in range(2)]
        yield cluster
    finally:
        cluster.shutdown()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> list[str]:
    work = made(tmp_path_factory.mktemp("undisturbed"))
    job = rooms.captions_job(work, variants=VARIANTS)
    runs.run(job, engine=HERE, bar=rooms.NoBar)
    return outcome(work)


def made(folder: Path) -> WorkDir:
    return rooms.made(folder, PARTS, ROWS)


def outcome(work: WorkDir) -> list[str]:
    table = work.table("rooms", "captions/occupancy")
    return [table.receipt(number).sha256 for number in table.parts()]


def begun(work: WorkDir, address: str) -> subprocess.Popen:
    """The command on all of a cluster, from the moment it has done a few parts."""
    words = ["captions", "--dataset", "rooms", "--segments", "labels", "--variants", str(VARIANTS)]
    words += ["--work", work.store.location, "--engine", "ray", "--workers", "4"]
    process = subprocess.Popen(
        [sys.executable, "-c", COMMAND, *words, "--ray-address", address],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "RSA_DATA_RAY_BEGIN_WITHIN": "6", "RAY_USAGE_STATS_ENABLED": "0"},
    )
    table, end = work.table("rooms", "captions/occupancy"), time.monotonic() + 60
    before = len(table.parts())
    while len(table.parts()) < before + 4 and process.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    return process


def ended(process: subprocess.Popen) -> tuple[int, str, str]:
    try:
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    return process.returncode, out, err


def processes(node) -> list[int]:
    """A node's own processes and those of the workers on it."""
    own = [each.process.pid for all_ in node.all_processes.values() for each in all_]
    theirs = [
        int(stat.parent.name)
        for stat in Path("/proc").glob("[0-9]*/stat")
        if parent(stat) == node.all_processes["raylet"][0].process.pid
    ]
    return own + theirs


def parent(stat: Path) -> int | None:
    try:
        return int(stat.read_text().rpartition(")")[2].split()[1])
    except OSError:
        return None


def send(signal_: int, pids: list[int]) -> None:
    for pid in pids:
        os.kill(pid, signal_)


@pytest.mark.ray
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_nodes_that_are_lost(tmp_path, cluster, undisturbed):
    work = made(tmp_path)
    process = begun(work, cluster.address)
    for node in cluster.nodes:
        send(signal.SIGKILL, processes(node))
    code, out, err = ended(process)
    assert code == 1, out + err
    assert "no worker could begin within 6 s. A worker takes 1 CPU on one node" in err
    assert "Traceback" not in err and "raylet" not in out, out + err
    assert 4 <= len(outcome(work)) < PARTS

    new = [cluster.add_node(num_cpus=2) for _ in range(2)]
    process = begun(work, cluster.address)
    send(signal.SIGKILL, processes(new[0]))
    code, out, err = ended(process)
    assert code == 0, out + err
    assert outcome(work) == undisturbed
    assert "Traceback" not in err and "raylet" not in out, out + err


class Nodes:
    """What a watch asks of Ray: three nodes, and from the second question on two."""

    def __init__(self):
        self.asked = 0

    def get_runtime_context(self):
        return self

    def get_node_id(self):
        return "own"

    def nodes(self):
        self.asked += 1
        names = ["own", "other", "third"]
        return [
            {"NodeID": n, "Alive": self.asked == 1 or n != "third", "Resources": {"CPU": 2.0}}
            for n in names
        ]


def test_lost_nodes_are_counted_once_in_the_log(monkeypatch, caplog):
    monkeypatch.setattr(ray_cluster, "EVERY", 0.01)
    ray = Nodes()
    watch = ray_cluster.Watch(ray, {"CPU": 1.0}, local=False)
    while ray.asked < 5:
        time.sleep(0.01)
    watch.check(working=False)
    watch.stop()
    told = "The Ray cluster has lost 1 of its nodes; 2 are left, which take over"
    assert [record.getMessage() for record in caplog.records] == [told]


@pytest.mark.ray
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("signal_", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "frozen"])
def test_a_head_that_is_lost_ends_the_command(tmp_path, cluster, undisturbed, signal_):
    work = made(tmp_path)
    process = begun(work, cluster.address)
    head = processes(cluster.head_node)
    send(signal_, head)
    try:
        # Workers go on with the parts that they get; few are left, so hold them as well.
        for node in cluster.nodes:
            send(signal.SIGSTOP, processes(node))
        code, out, err = ended(process)
    finally:
        for node in cluster.nodes:
            send(signal.SIGCONT, processes(node))
        if signal_ == signal.SIGSTOP:
            send(signal.SIGCONT, head)
    assert code == 1, out + err
    assert "the head of the Ray cluster has not answered for 6 s" in err
    assert "Traceback" not in err, err
    assert 4 <= len(outcome(work)) < PARTS
    # Workers that are left of the lost cluster end by themselves, and may finish a part meanwhile.
    runs.run(rooms.captions_job(work, variants=VARIANTS), engine=HERE, bar=rooms.NoBar)
    assert outcome(work) == undisturbed


@pytest.mark.ray
@pytest.mark.filterwarnings("ignore")
def test_workers_get_a_gpu_each_and_share_when_there_are_more_of_them(tmp_path):
    ray = pytest.importorskip("ray")
    detect = stages.bind("detect", {"segments": "labels", "device": "cuda"})
    job = jobs.job(rooms.made(tmp_path), detect, "rooms")
    ray.init(address="local", num_cpus=8, num_gpus=2, include_dashboard=False)
    try:
        assert gpus_of(ray, job, 2) == ["0", "1"]
        assert gpus_of(ray, job, 4) == ["0", "0", "1", "1"]
    finally:
        ray.shutdown()


def gpus_of(ray, job: jobs.Job, workers: int) -> list[str]:
    """CUDA_VISIBLE_DEVICES of each of so many workers."""
    from rsa_data.runner.engines.ray import Actors

    workers_ = Actors(job, {}, EngineOptions("ray", workers=workers))
    try:
        seen = [
            workers_.start().__ray_call__.remote(lambda self: os.environ["CUDA_VISIBLE_DEVICES"])
            for _ in range(workers)
        ]
        return sorted(ray.get(seen, timeout=60))
    finally:
        workers_.stop()


@pytest.mark.ray
@pytest.mark.filterwarnings("ignore")
def test_a_machine_without_the_gpu_that_workers_need_says_so_at_once(tmp_path):
    ray = pytest.importorskip("ray")
    options = {"segments": "labels", "device": "cuda", "threads": 3}
    job = jobs.job(rooms.made(tmp_path), stages.bind("detect", options), "rooms")
    if any(Path("/dev").glob("nvidia[0-9]*")):
        pytest.skip("there is a GPU")
    begun = time.monotonic()
    with pytest.raises(RsaDataError, match="takes 3 CPU, 1 GPU on one node; the nodes have 1 x 6"):
        list(dispatch.run(job, {}, [Task(0), Task(1)], EngineOptions("ray", workers=2)))
    assert time.monotonic() - begun < 60 and not ray.is_initialized()


@pytest.mark.parametrize(
    "options, gpus, workers, expected",
    [
        ({}, [0], 3, {"CPU": 1}),
        ({"threads": 4, "device": "cpu"}, [2], 3, {"CPU": 4}),
        ({"threads": 2, "device": "auto"}, [0, 0], 3, {"CPU": 2}),
        ({"threads": 2, "device": "auto"}, [0, 4], 3, {"CPU": 2, "GPU": 1}),
        ({"device": "cuda"}, [2, 2], 4, {"CPU": 1, "GPU": 1}),
        ({"device": "cuda"}, [2, 2], 9, {"CPU": 1, "GPU": 1 / 3}),
        ({"device": "cuda"}, [], 9, {"CPU": 1, "GPU": 1}),
    ],
)
def test_what_a_worker_takes_of_a_cluster(tmp_path, options, gpus, workers, expected):
    job = jobs.Job("work", "rooms", "embed", options, (), "embeddings", None)
    nodes = [{"Alive": True, "Resources": {"CPU": 8.0, "GPU": float(n)}} for n in gpus]
    nodes.append({"Alive": False, "Resources": {"CPU": 8.0, "GPU": 16.0}})
    assert ray_cluster.size(job, nodes, workers) == expected
