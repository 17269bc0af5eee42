"""Memory and open files of a worker over 100,000 and 1,000,000 rows.

    python benchmarks/memory.py [--rows 1000000] [--part 2000]

Captions of samples made in memory, then embeddings by a stub encoder (a hash of the text as 256
float16 values), one process for each count. Peak memory may be at most 1.1 times that of a tenth of
the rows, and no file may stay open. A row is an image; each has five captions. What a run keeps of
a part is a few numbers; most of the difference is Arrow's allocator, which gives freed pages back
when it likes: with ARROW_DEFAULT_MEMORY_POOL=system both peaks are lower and nearer to each other.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

import numpy as np
import pyarrow as pa
import recording
import rooms

from rsa_data.embeddings import embed
from rsa_data.runner import fingerprints, jobs, parts, runs, stages
from rsa_data.runner.stage import Step
from rsa_data.store import schemas
from rsa_data.store.tables import WorkDir


def stub(**_: object) -> Step:
    """An encoder that costs nothing: each text's id, repeated, as its feature."""

    def step(captions: pa.Table) -> pa.Table:
        ids, texts = embed.distinct_texts(captions)
        codes = np.frombuffer(b"".join(ids.to_pylist()), np.uint8).reshape(len(ids), 16)
        features = np.tile(codes, (1, 16)).astype(np.float16)
        return schemas.from_columns(
            "embeddings",
            {
                "text_id": ids,
                "embedding": schemas.embedding_column(features),
                "n_tokens": np.full(len(texts), 9, np.int32),
                "truncated": [False] * len(texts),
            },
        )

    return step


def measure(rows: int, part: int, folder: Path) -> None:
    """In a process of its own: makes the tables, prints peak memory (kB), open files, seconds."""
    work = WorkDir(str(folder))
    for first in range(0, rows // part, 50):  # a few at a time: the test's own data must not count
        rooms.made(folder, min(50, rows // part - first), part, first)
    # The inputs were made in this process; what they left of the peak is the same for all counts.
    runs.run(rooms.captions_job(work), bar=rooms.NoBar)
    job = jobs.job(
        work, stages.bind("embed", {"encoder": "minilm"}), "rooms", upstream="captions/occupancy"
    )
    description = fingerprints.describe(job)
    output = job.table(job.output)
    output.bind(description)
    files = []
    begun = time.monotonic()
    for number in work.table("rooms", "samples").parts():
        parts.run_part(job, stub(), description, number)
        files.append(len(list(Path("/proc/self/fd").iterdir())))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(peak, files[0], max(files), files[-1], f"{time.monotonic() - begun:.1f}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--part", type=int, default=2000)
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.measure:
        measure(given.rows, given.part, given.measure)
        return 0
    peaks, rows_of = [], []
    for rows in (given.rows // 10, given.rows):
        with tempfile.TemporaryDirectory(prefix="rsa-data-memory-") as folder:
            begun = time.monotonic()
            words = [sys.executable, __file__, "--rows", str(rows), "--part", str(given.part)]
            ended = subprocess.run(
                [*words, "--measure", folder], stdout=subprocess.PIPE, text=True, check=True
            )
            peak, first, most, last, _ = ended.stdout.split()
            used = sum(p.stat().st_size for p in Path(folder).rglob("*.parquet"))
        peaks.append(int(peak))
        rows_of.append((rows, round(int(peak) / 1024), int(most), int(last)))
        print(
            f"{rows:,} rows: peak {int(peak) / 1024:.0f} MiB, files open at first {first}, at most "
            f"{most}, at last {last}; {used / 1e6:.0f} MB, {time.monotonic() - begun:.0f} s",
            flush=True,
        )
    recording.table(
        "memory",
        "Memory of a worker",
        ("images", "peak MiB", "files open at most", "files open at the end"),
        rows_of,
        note="Captions and embeddings by an encoder that computes nothing.",
        part=given.part,
    )
    ratio = peaks[1] / peaks[0]
    print(f"peak of 10 times the rows: {ratio:.3f} times (at most 1.1)")
    return 0 if ratio <= 1.1 and int(last) <= int(first) else 1


if __name__ == "__main__":
    sys.exit(main())
