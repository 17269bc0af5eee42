"""Peak memory of train-head when its tables are larger than what it may hold.

    python benchmarks/train_memory.py [--images 20000]

Writes training tables (1024 float16 features and 1024 pixels an image, 6 KiB), then trains one
epoch in a fresh process each: with all of it in memory, and with a limit of half the tables.
Counted is the process's own memory; the system may drop the pages of files that it has mapped.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from rsa_data.store.tables import WorkDir

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))
import recording
from made_tables import write

CHILD = """
import re, sys, threading, time
from pathlib import Path
import torch
from rsa_data.heads.train.train_head import train_head
from rsa_data.common.options import call
from rsa_data.store.tables import WorkDir

def now():
    text = Path("/proc/self/status").read_text()
    return int(re.search(r"RssAnon:\\s+(\\d+)", text)[1]) / 2**20

def watch():
    global peak
    while True:
        peak = max(peak, now())
        time.sleep(0.01)

before = peak = now()
begun = time.perf_counter()
threading.Thread(target=watch, daemon=True).start()
call(train_head, WorkDir(sys.argv[1]), name=sys.argv[2], memory=float(sys.argv[3]), epochs=1,
     head="linear", threads=1)
print(f"{peak - before:.3f} {time.perf_counter() - begun:.1f}")
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--images", type=int, default=20_000)
    given = parser.parse_args()
    rng = np.random.default_rng(0)
    pixels = rng.uniform(1, 9, (500, 1024)).astype(np.float16)
    with tempfile.TemporaryDirectory() as folder:
        work = WorkDir(folder)
        for first in range(0, given.images, 2000):
            count = min(2000, given.images - first)
            texts = [str(first + i) for i in range(count)]
            features = rng.normal(size=(count, 1024)).astype(np.float16)
            write(
                work,
                "nyuv2",
                scenes=[f"scene {i % 50}" for i in range(count)],
                texts=[[text] for text in texts],
                features=dict(zip(texts, features, strict=True)),
                relative=pixels[np.arange(count) % 500],
                metric=pixels[np.arange(count) % 500],
                part=2000,
                first_part=first // 2000,
            )
        size = sum(f.stat().st_size for f in Path(folder).rglob("*.parquet")) / 2**30
        print(f"tables: {size:.3f} GiB")
        rows = []
        for limit in (4 * size, size / 2):
            command = [sys.executable, "-c", CHILD, folder, f"m{limit:.2f}", str(limit)]
            peak, seconds = subprocess.check_output(command, text=True).split()
            rows.append((round(limit, 3), float(peak), float(seconds)))
            print(
                f"--memory {limit:.3f}: peak {peak} GiB above the imports, {seconds} s", flush=True
            )
        recording.table(
            "train_memory",
            "Memory of train-head",
            ("--memory, GiB", "peak GiB above the imports", "seconds"),
            rows,
            note=f"{given.images:,} images in tables of {size:.2f} GiB, one epoch.",
        )


if __name__ == "__main__":
    main()
