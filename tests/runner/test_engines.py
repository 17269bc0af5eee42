"""Engines: the same bytes from one process, several, and Ray; no part is lost with its worker."""

import hashlib
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest
import rooms

from rsa_data.common.errors import RsaDataError, TransientError
from rsa_data.runner import fingerprints, jobs, runs, stages
from rsa_data.runner.engines import dispatch
from rsa_data.runner.engines.pool import EngineOptions, Result, Task, WorkerEvent
from rsa_data.runner.jobs import Job
from rsa_data.store.logs import last_run, rate
from rsa_data.store.tables import WorkDir

ENGINES = [
    pytest.param(EngineOptions(workers=1), id="here"),
    pytest.param(EngineOptions(workers=2), id="local-2"),
    pytest.param(EngineOptions(workers=4), id="local-4"),
    pytest.param(EngineOptions("ray", workers=1), id="ray-1", marks=pytest.mark.ray),
    pytest.param(EngineOptions("ray", workers=2), id="ray-2", marks=pytest.mark.ray),
    pytest.param(EngineOptions("ray", workers=4), id="ray-4", marks=pytest.mark.ray),
]
MANY = [
    pytest.param(EngineOptions(workers=2), id="local"),
    pytest.param(EngineOptions("ray", workers=2), id="ray", marks=pytest.mark.ray),
]


def files(work: WorkDir, table: str = "captions/occupancy") -> dict[str, bytes | None]:
    """Every file of a table by name: the whole content, hidden files included."""
    folder = Path(work.store.location) / "rooms" / table
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> dict[str, bytes | None]:
    work = rooms.made(tmp_path_factory.mktemp("undisturbed"))
    runs.run(rooms.captions_job(work), bar=rooms.NoBar)
    return files(work)


@pytest.fixture(autouse=True)
def ray_if_marked(request):
    if request.node.get_closest_marker("ray"):
        pytest.importorskip("ray")


@pytest.mark.parametrize("how", ENGINES)
@pytest.mark.filterwarnings("ignore")  # Ray's own
def test_all_engines_give_the_same_bytes(tmp_path, how, undisturbed):
    work = rooms.made(tmp_path)
    bar = rooms.NoBar()
    summary = runs.run(rooms.captions_job(work), engine=how, bar=lambda title, total: bar)
    assert (summary.done, summary.ok, summary.undone, bar.rows) == (4, 200, {}, 200)
    assert files(work) == undisturbed


@pytest.mark.parametrize("how", MANY)
@pytest.mark.filterwarnings("ignore")
def test_a_worker_that_dies_once_costs_nothing(tmp_path, how, undisturbed, monkeypatch):
    work = rooms.made(tmp_path)
    # Each process dies at its second commit; another one is begun for the part.
    monkeypatch.setenv("RSA_DATA_FAILPOINT", "receipt:2")
    summary = runs.run(rooms.captions_job(work), engine=how, bar=rooms.NoBar)
    assert (summary.done, summary.undone) == (4, {})
    assert files(work) == undisturbed


@pytest.mark.parametrize("how", MANY)
@pytest.mark.filterwarnings("ignore")
def test_workers_that_die_again_and_again_end_the_run(tmp_path, how, undisturbed, monkeypatch):
    work = rooms.made(tmp_path)
    monkeypatch.setenv("RSA_DATA_FAILPOINT", "receipt")
    with pytest.raises(RsaDataError, match="workers died one after the other; the last one"):
        runs.run(rooms.captions_job(work), engine=how, bar=rooms.NoBar)
    monkeypatch.delenv("RSA_DATA_FAILPOINT")
    runs.run(rooms.captions_job(work), engine=how, bar=rooms.NoBar)
    assert files(work) == undisturbed


def imported_job(work: WorkDir, label: str) -> Job:
    """Captions that lie in the file texts.csv of the folder in which the command is given."""
    configured = stages.bind("captions", {"style": "import:texts.csv", "label": label})
    return jobs.job(work, configured, "rooms")


def write_texts(folder: Path, text: str) -> None:
    folder.mkdir(exist_ok=True)
    rows = [f"rooms/train/{part:03d}/{row:05d},{text}" for part in range(2) for row in range(50)]
    (folder / "texts.csv").write_text("\n".join(["sample_id,text", *rows]))


@pytest.mark.ray
@pytest.mark.filterwarnings("ignore")
def test_relative_paths_are_those_of_the_command_wherever_ray_was_started(tmp_path, monkeypatch):
    import ray

    work = rooms.made(tmp_path / "work", parts=2)
    write_texts(tmp_path / "command", "A bed.")
    write_texts(tmp_path / "cluster", "Another room.")
    monkeypatch.chdir(tmp_path / "cluster")
    ray.init(address="local", num_cpus=1, include_dashboard=False, log_to_driver=False)
    try:
        monkeypatch.chdir(tmp_path / "command")
        runs.run(imported_job(work, "far"), engine=EngineOptions("ray"), bar=rooms.NoBar)
    finally:
        ray.shutdown()
    runs.run(imported_job(work, "near"), bar=rooms.NoBar)
    far, near = (files(work, f"captions/{label}") for label in ("far", "near"))
    assert far["_table.json"] == near["_table.json"]
    assert set(work.table("rooms", "captions/far").read(1)["text"].to_pylist()) == {"A bed."}
    parts = [name for name in near if name.endswith(".parquet")]
    assert len(parts) == 2 and all(far[name] == near[name] for name in parts)


@pytest.mark.parametrize("workers", [1, 2])
def test_files_that_are_replaced_before_a_worker_reads_them_end_the_run(
    tmp_path, monkeypatch, workers
):
    work = rooms.made(tmp_path / "work", parts=2)
    write_texts(tmp_path, "A bed.")
    monkeypatch.chdir(tmp_path)
    job = imported_job(work, "texts")
    description = fingerprints.describe(job)
    job.table(job.output).bind(description)
    write_texts(tmp_path, "A bad.")  # of the same size
    now = hashlib.sha256((tmp_path / "texts.csv").read_bytes()).hexdigest()
    expected = f"texts.csv: expected sha256 {description.files['texts']}, .* found {now}: replaced"
    with pytest.raises(RsaDataError, match=expected):
        list(dispatch.run(job, description, [Task(0), Task(1)], EngineOptions(workers=workers)))
    assert job.table(job.output).parts() == []
    write_texts(tmp_path, "A bed.")
    assert runs.run(job, engine=EngineOptions(workers=workers), bar=rooms.NoBar).done == 2


@pytest.mark.parametrize("how", MANY)
@pytest.mark.filterwarnings("ignore")
def test_a_stage_that_cannot_begin_says_why(tmp_path, how):
    work = rooms.made(tmp_path)
    job = rooms.captions_job(work, style="import:nowhere.json")
    with pytest.raises(RsaDataError, match="found nothing at nowhere"):
        list(dispatch.run(job, fingerprints.describe(job), [Task(0), Task(1)], how))


@pytest.mark.parametrize("how", MANY)
@pytest.mark.filterwarnings("ignore")
def test_a_worker_over_its_memory_limit_is_ended_and_named(tmp_path, how, undisturbed):
    work = rooms.made(tmp_path)
    little, enough = replace(how, memory=10**6), replace(how, memory=8 * 10**9)
    with pytest.raises(RsaDataError, match=r"held more than the 1,000,000 bytes of --memory-limit"):
        runs.run(rooms.captions_job(work), engine=little, bar=rooms.NoBar)
    runs.run(rooms.captions_job(work), engine=enough, bar=rooms.NoBar)
    assert files(work) == undisturbed


TASKS = [Task(n) for n in range(4)]


class Lossy:
    """A pool of one worker that dies on part 1 each time, and on nothing else."""

    def __init__(self):
        self.begun, self.waiting = 0, []

    def start(self):
        self.begun += 1
        self.waiting.append(WorkerEvent(self.begun, "ready"))
        return self.begun

    def dispatch(self, worker, task):
        result = Result(task.number, {"part": task.number})
        kind, value = ("died", "burnt") if task.number == 1 else ("result", result)
        self.waiting.append(WorkerEvent(worker, kind, value))

    def events(self, seconds):
        events, self.waiting = self.waiting, []
        return events

    def stop(self):
        pass


def test_a_part_that_kills_its_worker_is_left_undone_and_the_others_are_done():
    pool = Lossy()
    results = list(dispatch.run(None, {}, TASKS, EngineOptions(), None, lambda *_: pool))
    done = {r.number: r.receipt for r in results if r.error is None}
    undone = {r.number: str(r.error) for r in results if r.error is not None}
    assert sorted(done) == [0, 2, 3]
    assert undone == {1: "its worker died 3 times; the last one burnt"}
    assert isinstance(results[-1].error, TransientError) and pool.begun == 3


def freeze_once(pid: int, folder: Path) -> None:
    """Stops the first worker process below `pid` as soon as a part has its receipt."""
    while not list(folder.glob("_part-*.json")):
        time.sleep(0.01)
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    workers = [p for p in children if b"spawn_main" in Path(f"/proc/{p}/cmdline").read_bytes()]
    os.kill(int(workers[0]), signal.SIGSTOP)


def test_a_worker_that_hangs_does_not_hold_the_run(tmp_path, undisturbed, monkeypatch):
    monkeypatch.setattr(dispatch, "LATE_AFTER", 2.0)
    monkeypatch.setattr(dispatch, "LATE_TIMES", 2)
    work = rooms.made(tmp_path)
    table = tmp_path / "rooms" / "captions" / "occupancy"
    thread = threading.Thread(target=freeze_once, args=(os.getpid(), table))
    thread.start()
    summary = runs.run(rooms.captions_job(work), engine=EngineOptions(workers=2), bar=rooms.NoBar)
    thread.join()
    assert (summary.done, summary.undone) == (4, {})
    assert files(work) == undisturbed


class Slow(Lossy):
    """A pool of two workers, of which the first never says anything."""

    def start(self):
        self.begun += 1
        self.waiting.append(WorkerEvent(self.begun, "ready"))

    def dispatch(self, worker, task):
        if worker == 2:
            result = Result(task.number, {"part": task.number})
            self.waiting.append(WorkerEvent(worker, "result", result))
        else:
            self.held = task


def test_the_part_of_a_worker_that_says_nothing_is_given_to_an_idle_one(monkeypatch):
    monkeypatch.setattr(dispatch, "LATE_AFTER", 0.2)
    pool = Slow()
    results = list(dispatch.run(None, {}, TASKS, EngineOptions(workers=2), None, lambda *_: pool))
    assert sorted(r.number for r in results) == [0, 1, 2, 3] and pool.held is not None
    assert results[-1].number == pool.held.number


@pytest.mark.parametrize(
    "signal_, how",
    [
        (signal.SIGINT, "--workers 1"),
        (signal.SIGTERM, "--workers 1"),
        (signal.SIGINT, "--workers 2"),
        (signal.SIGTERM, "--workers 2"),
        pytest.param(signal.SIGTERM, "--workers 2 --engine ray", marks=pytest.mark.ray),
    ],
)
def test_a_stopped_command_exits_130_leaves_no_process_and_goes_on(tmp_path, signal_, how):
    work = rooms.made(tmp_path, parts=40, rows=2000)
    words = [sys.executable, "-m", "rsa_data", "captions", "--dataset", "rooms"]
    words += ["--segments", "labels", "--work", str(tmp_path), *how.split()]
    process = subprocess.Popen(
        words, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    table = work.table("rooms", "captions/occupancy")
    wait_until(lambda: len(table.parts()) >= 2 or process.poll() is not None)
    os.killpg(process.pid, signal_)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130, out + err
    assert err.strip().endswith("run the same command to continue."), err
    assert "Traceback" not in err
    wait_until(lambda: not in_group(process.pid))
    assert 2 <= len(table.parts()) < 40
    again = subprocess.run(words, capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stderr
    assert table.parts() == list(range(40))
    assert not [name for name in files(work) if name.startswith(".")]
    assert rate(last_run(work, "rooms", "captions/occupancy")) > 0


def wait_until(true, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def in_group(group: int) -> list[str]:
    """Commands of the live processes in a process group."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            _, _, rest = stat.read_text().rpartition(")")
        except OSError:
            continue
        state, _, its_group = rest.split()[:3]
        if int(its_group) == group and state != "Z":
            found.append(stat.parent.name)
    return found
