"""Throughput of workers, local and Ray; each also killed in the middle and run again.

    python benchmarks/scale.py [--parts 24] [--rows 150] [--workers 1,2,4] [--engines local,ray]
        [--images DIR --model yolox_nano.onnx] [--no-kill] [--record]

The stage is embed with the MiniLM encoder over captions made here, or, with --images, detect with
YOLOX nano over the images of a folder, --rows of them a part; one thread a worker. It prints rows a
second of the whole command, of the time between the first and the last part, and what the start
cost (the whole time less what the rows take at the second rate), and whether every part has the
sha256 of the first run's.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

import recording
import rooms

from rsa_data.runner import chains, runs
from rsa_data.store.tables import WorkDir


@dataclass(frozen=True)
class Case:
    """A stage to run. prepare : folder -> the work dir with its input. words : of the command."""

    dataset: str
    table: str
    unit: str
    prepare: Callable[[Path], WorkDir]
    words: tuple[str, ...]

    def command(self, work: Path, engine: str, workers: int) -> list[str]:
        command = [sys.executable, "-m", "rsa_data", *self.words, "--threads", "1"]
        return [*command, "--work", str(work), "--engine", engine, "--workers", str(workers)]

    def outcome(self, work: WorkDir) -> list[str]:
        table = work.table(self.dataset, self.table)
        return [table.receipt(n).sha256 for n in table.parts()]

    def between(self, folder: Path, rows: list[int]) -> float:
        """Rows a second from the end of the first part to the end of the last."""
        # A receipt is the commit of its part, and the log has whole seconds only.
        receipts = (folder / self.dataset / self.table).glob("_part-*.json")
        moments = [receipt.stat().st_mtime for receipt in receipts]
        return (sum(rows) - rows[0]) / (max(moments) - min(moments))


def embed(parts: int, rows: int) -> Case:
    def prepare(folder: Path) -> WorkDir:
        work = rooms.made(folder, parts, rows)
        runs.run(rooms.captions_job(work), bar=rooms.NoBar)
        return work

    words = ("embed", "--encoder", "minilm")
    return Case("rooms", "embeddings/occupancy/minilm", "texts", prepare, words)


def detect(images: Path, model: Path, parts: int, rows: int) -> Case:
    sizes = {"part_size": rows, "test_part_size": rows}

    def prepare(folder: Path) -> WorkDir:
        there = sorted(path for path in images.iterdir() if path.suffix in (".jpg", ".png"))
        for number in range(parts * rows):
            place = folder / "images" / f"{number:05d}{there[number % len(there)].suffix}"
            place.parent.mkdir(parents=True, exist_ok=True)
            place.symlink_to(there[number % len(there)].resolve())
        work = WorkDir(str(folder))
        chains.samples(work, "folder:photos", sizes, root=folder / "images")
        return work

    words = ("detect", "--dataset", "photos", "--segments", "yolox-nano")
    words += ("--segmenter-weights", str(model))
    return Case("photos", "segments/yolox-nano", "images", prepare, words)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", type=int, default=24)
    parser.add_argument("--rows", type=int, default=150)
    parser.add_argument("--workers", default="1,2,4")
    parser.add_argument("--engines", default="local,ray")
    parser.add_argument("--images", type=Path)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--no-kill", action="store_true")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/scale.json")
    given = parser.parse_args()
    if given.images:
        case = detect(given.images, given.model, given.parts, given.rows)
    else:
        case = embed(given.parts, given.rows)
    expected: list[str] = []
    bad, table = 0, []
    print(
        f"engine, workers, {case.unit}/s of all, {case.unit}/s once begun, start in s, same bytes"
    )
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before this began")
    for engine in given.engines.split(","):
        for workers in map(int, given.workers.split(",")):
            with tempfile.TemporaryDirectory(prefix="rsa-data-scale-") as name:
                folder = Path(name) / "whole"
                work = case.prepare(folder)
                begun = time.monotonic()
                subprocess.run(
                    case.command(folder, engine, workers), check=True, capture_output=True
                )
                seconds = time.monotonic() - begun
                made = work.table(case.dataset, case.table)
                rows = [made.receipt(n).rows for n in made.parts()]
                expected = expected or case.outcome(work)
                same = case.outcome(work) == expected
                rate = case.between(folder, rows)
                start = seconds - sum(rows) / rate
                resumed = given.no_kill or killed(case, Path(name) / "killed", engine, workers) == (
                    expected
                )
                bad += (not same) + (not resumed)
                table.append((engine, workers, round(sum(rows) / seconds, 1), round(rate, 1),
                              round(start, 1), "yes" if same and resumed else "no"))  # fmt: skip
                print(*table[-1], flush=True)
    if not given.record:
        return 1 if bad else 0
    recording.table(
        "scale",
        f"Workers, {case.words[0]}",
        ("engine", "workers", f"{case.unit}/s, whole", f"{case.unit}/s, once begun", "start, s",
         "same bytes"),
        table,
        note=f"{given.parts} parts of {given.rows} {case.unit}, one thread a worker. "
        + ("" if given.no_kill else "Each was also killed at half of its parts and run again."),
        packages=("ray",),
    )  # fmt: skip
    return 1 if bad else 0


def killed(case: Case, folder: Path, engine: str, workers: int) -> list[str]:
    """The outcome of a run that was killed at half of its parts and begun again."""
    work = case.prepare(folder)
    command = case.command(folder, engine, workers)
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.STDOUT)
    table = work.table(case.dataset, case.table)
    half = len(work.table(case.dataset, "samples").parts()) // 2
    while process.poll() is None and len(table.parts()) < half:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    subprocess.run(command, check=True, capture_output=True)
    return case.outcome(work)


if __name__ == "__main__":
    sys.exit(main())
