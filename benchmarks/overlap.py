"""What running stages side by side could give: how many cores each of them keeps busy by itself.

    python benchmarks/overlap.py [--threads 2] [--scenes 120] [--models ../shared/data/models]

detect (YOLOX nano) and depth (tu2020) on rendered rooms, each with all threads. 50 times a second
the threads that run or are ready to run are counted, so that other work on the machine changes
nothing. Where a stage alone keeps c of n cores busy, a second one beside it can raise the rate
n / c times at most. Linux only, since the states of threads come from /proc.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import recording

SHARED = Path(__file__).parents[2] / "shared" / "data" / "models"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--scenes", type=int, default=120)
    parser.add_argument("--models", type=Path, default=SHARED)
    given = parser.parse_args()
    yolox, tu2020 = "yolox_nano.onnx", "tu2020_mbv2_blconv7dw_nyu_224.onnx"
    ways = {
        "detect": ("--segments", "yolox-nano", "--segmenter-weights", given.models / yolox),
        "depth": ("--depth-model", "tu2020", "--depth-weights", given.models / tu2020),
    }
    rows, shares = [], []
    with tempfile.TemporaryDirectory() as folder:
        common = ("--dataset", "synthetic-indoor", "--root", f"{folder}/scenes")
        common += ("--dataset-option", f"scenes={given.scenes}", "--work", f"{folder}/work")
        # Renders and indexes, so that both stages find everything.
        command(["detect", *common, "--segments", "coco-panoptic"]).wait()
        for stage, words in ways.items():
            seen = counts(command([stage, *common, *words, "--threads", given.threads]))
            busy = np.minimum(seen, given.threads)
            begun = int(np.argmax(busy == given.threads))
            shares.append(busy.mean() / given.threads)
            rows.append([stage, round(float(busy.mean()), 2), round(float(busy[begun:].mean()), 2),
                         round(1 / shares[-1], 2)])  # fmt: skip
            print(*rows[-1], flush=True)
    both = float(np.mean(shares))
    rows.append(["both, one after the other", round(both * given.threads, 2), None,
                 round(1 / both, 2)])  # fmt: skip
    recording.table(
        "overlap",
        "Cores that a stage keeps busy",
        ("stage", "cores, whole command", "cores, once begun", "gain beside others, at most"),
        rows,
        note=f"Of {given.threads} cores. Stages of one run follow each other: a gain of less than "
        "1.15 was not worth an order of work that depends on more than the tables.",
        threads=given.threads,
        images=2 * given.scenes + 80,
    )


def command(words: list[object]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "rsa_data", *map(str, words)], stdout=subprocess.DEVNULL
    )


def counts(process: subprocess.Popen[bytes]) -> np.ndarray:
    """Threads of a process that run or wait for a core, 50 times a second, until its end."""
    seen = []
    while process.poll() is None:
        seen.append(ready(Path(f"/proc/{process.pid}/task")))
        time.sleep(0.02)
    if process.returncode:
        sys.exit(f"{process.args}: ended with {process.returncode}")
    return np.array(seen)


def ready(tasks: Path) -> int:
    found = 0
    try:
        for task in tasks.iterdir():
            state = (task / "stat").read_text().rpartition(")")[2].split()[0]
            found += state == "R"
    except OSError:  # a thread, or all of it, has ended
        pass
    return found


if __name__ == "__main__":
    main()
