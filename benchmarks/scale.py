"""Throughput of workers, local and Ray; each also killed in the middle and run again.

    python benchmarks/scale.py [--parts 24] [--rows 150] [--workers 1,2,4] [--engines local,ray]

The stage is embed with the MiniLM encoder, one thread a worker, over captions made here. It prints
texts a second of the whole command (start of the workers included) and of the time between the
first and the last part, and whether every part has the sha256 of the first run's.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

import rooms

from rsa_data.runner import runs
from rsa_data.store.tables import WorkDir

TABLE = "embeddings/occupancy/minilm"


def words(work: Path, engine: str, workers: int) -> list[str]:
    command = [sys.executable, "-m", "rsa_data", "embed", "--encoder", "minilm"]
    command += ["--threads", "1", "--work", str(work)]
    return [*command, "--engine", engine, "--workers", str(workers)]


def prepared(folder: Path, parts: int, rows: int) -> WorkDir:
    work = rooms.made(folder, parts, rows)
    runs.run(rooms.captions_job(work), bar=rooms.NoBar)
    return work


def outcome(work: WorkDir) -> list[str]:
    table = work.table("rooms", TABLE)
    return [table.receipt(n).sha256 for n in table.parts()]


def between(folder: Path, texts: list[int]) -> float:
    """Texts a second from the end of the first part to the end of the last."""
    log = max((folder / "logs").glob("rooms.embeddings*"))
    events = [json.loads(line) for line in log.read_text().splitlines()]
    parts = [event for event in events if event["event"] == "part"]
    begin = next(event for event in events if event["event"] == "begin")
    moments = [time.mktime(time.strptime(e["time"], "%Y-%m-%dT%H:%M:%SZ")) for e in (begin, *parts)]
    seconds = max(moments) - min(moments[1:])
    return (sum(texts) - texts[0]) / seconds if seconds else float("nan")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", type=int, default=24)
    parser.add_argument("--rows", type=int, default=150)
    parser.add_argument("--workers", default="1,2,4")
    parser.add_argument("--engines", default="local,ray")
    given = parser.parse_args()
    expected: list[str] = []
    bad = 0
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before this began")
    for engine in given.engines.split(","):
        for workers in map(int, given.workers.split(",")):
            with tempfile.TemporaryDirectory(prefix="rsa-data-scale-") as name:
                whole, killed = Path(name) / "whole", Path(name) / "killed"
                work = prepared(whole, given.parts, given.rows)
                begun = time.monotonic()
                subprocess.run(words(whole, engine, workers), check=True, capture_output=True)
                seconds = time.monotonic() - begun
                table = work.table("rooms", TABLE)
                texts = [table.receipt(n).rows for n in table.parts()]
                expected = expected or outcome(work)
                same = outcome(work) == expected

                work = prepared(killed, given.parts, given.rows)
                process = subprocess.Popen(
                    words(killed, engine, workers),
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.STDOUT,
                )
                table = work.table("rooms", TABLE)
                while process.poll() is None and len(table.parts()) < given.parts // 2:
                    time.sleep(0.02)
                process.send_signal(signal.SIGKILL)
                process.wait()
                there = len(table.parts())
                subprocess.run(words(killed, engine, workers), check=True, capture_output=True)
                resumed = outcome(work) == expected
                bad += (not same) + (not resumed)
                print(
                    f"{engine:5} {workers} workers: {sum(texts) / seconds:6.0f} texts/s in all, "
                    f"{between(whole, texts):6.0f} once begun; same sha256: {same}; killed after "
                    f"{there} of {given.parts} parts and run again: {resumed}",
                    flush=True,
                )
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
