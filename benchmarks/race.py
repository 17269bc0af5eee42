"""Two trainings under one name at once, one with --start-over: whose head is there in the end?

    python benchmarks/race.py [--times 20] [--record]

Both train on the same small tables with other options (seeds and epochs), each in a process of its
own; the second begins at a random moment of the first. When both have ended, what is there must be
one training's alone: head.json, weights, history and the description of the folder agree, verify
finds nothing, and the head is byte for byte what that training makes undisturbed. That neither
ended with a head is allowed; then the same command again must make one.
"""

import argparse
import random
import shutil
import sys
import tempfile
import time
from collections import Counter
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import crash
import recording

_ENDS = ("first", "second", "none", "mixed")
NAME = "contested"
FILES = ("head.json", "head.safetensors", "history.parquet", "_table.json")


def words(seed: int, over: bool) -> list[str]:
    """The command line of one training."""
    given = f"train-head --work work --name {NAME} --head linear --threads 1 --checkpoint-every 0"
    return [
        *given.split(),
        "--seed",
        str(seed),
        "--epochs",
        str(3 + seed),
        *["--start-over"] * over,
    ]


def head(place: Path) -> dict[str, bytes]:
    """The files of the head that are there."""
    folder = place / "work" / "heads" / NAME
    return {name: (folder / name).read_bytes() for name in FILES if (folder / name).is_file()}


def made(place: Path) -> None:
    """A work dir with the tables of a few rooms."""
    place.mkdir()
    text = crash.JOB.format(root="rooms").partition("[train-head]")[0]
    (place / "job.toml").write_text(text)
    if crash.ended(crash.start(["run", "job.toml", "--work", "work"], place)):
        raise SystemExit((place.parent / "said").read_text())


def race(place: Path, begun: Path, alone: list[dict[str, bytes]], moment: float) -> str:
    """Whose head is there after two trainings: first, second or none; "mixed" is what is wrong."""
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(begun, place, symlinks=True)
    first = crash.start(words(0, False), place)
    time.sleep(moment)
    second = crash.start(words(1, True), place)
    crash.ended(first), crash.ended(second)
    there = head(place)
    if "head.json" not in there:
        if crash.ended(crash.start(words(1, False), place)) or head(place) != alone[1]:
            return "mixed"
        return "none"
    problems = crash.ended(crash.start(["verify", "--work", "work"], place))
    for name, files in zip(("first", "second"), alone, strict=True):
        if there == files and not problems:
            return name
    return "mixed"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--record", action="store_true", help="keep the figures")
    given = parser.parse_args()
    for module in crash.PRELOADED:
        import_module(module)
    base = Path(tempfile.mkdtemp(prefix="rsa-data-race-"))
    begun, place = base / "begun", base / "place"
    made(begun)
    alone, seconds = [], 0.0
    for seed in (0, 1):
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(begun, place, symlinks=True)
        start = time.monotonic()
        if crash.ended(crash.start(words(seed, False), place)):
            raise SystemExit((base / "said").read_text())
        seconds = time.monotonic() - start  # of the last, when files are in the cache
        alone.append(head(place))
    chance, found = random.Random(given.seed), Counter[str]()
    for number in range(given.times):
        moment = chance.uniform(0, seconds)
        outcome = race(place, begun, alone, moment)
        found[outcome] += 1
        print(f"{number + 1:3}: the second after {moment:.2f} s: {outcome}", flush=True)
    shutil.rmtree(base)
    row = [given.times, *(found[k] for k in _ENDS)]
    print(dict(zip(("times", *_ENDS), row, strict=True)))
    if given.record:
        title = "Whose head is there after two trainings under one name"
        recording.table("race", title, ("times", *_ENDS), [row])
    return 1 if found["mixed"] else 0


if __name__ == "__main__":
    sys.exit(main())
