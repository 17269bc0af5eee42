"""Images a second of the detect stage against a straightforward loop, both in one run.

    python benchmarks/detect.py IMAGES MODEL.onnx [--source yolox-nano] [--rounds 5]

IMAGES is a folder (every .jpg below it is read). The loop does what a first script does: read,
prepare, run a session with two threads, decode, one after the other. The stage does the same work
with the same functions, overlapped. Rounds alternate between the two, so that what else runs on
the machine slows both; the ratio of the medians is what lasts.
"""

import argparse
import statistics
import threading
import time
from pathlib import Path

import recording

from rsa_data.common.cards import card_of
from rsa_data.datasets.images import read_image
from rsa_data.segments import graph, onnx


def loop(detector, paths):
    """Everything in turn. Returns the seconds it took and what was found."""
    start, found = time.perf_counter(), []
    for path in paths:
        prepared = detector.prepare(read_image(path))
        (outputs,) = detector.run([prepared])
        found.append(detector.finish(outputs, prepared[1]))
    return time.perf_counter() - start, found


def stage(detector, paths, threads):
    """Overlapped. Returns the seconds, what was found, and how long at least one run was going."""
    lock, going, since, busy = threading.Lock(), 0, 0.0, 0.0

    def run(batch):
        nonlocal going, since, busy
        with lock:
            going += 1
            if going == 1:
                since = time.perf_counter()
        outputs = detector.run(batch)
        with lock:
            going -= 1
            if going == 0:
                busy += time.perf_counter() - since
        return outputs

    def read(path):
        return detector.prepare(read_image(Path(path)))

    timed = graph.Detector(detector.prepare, run, detector.finish, detector.batches)
    start = time.perf_counter()
    found = list(onnx.detect(timed, read, list(map(str, paths)), threads=threads))
    return time.perf_counter() - start, found, busy


def main():
    """Measures both and prints images a second, their ratio and the session's share of the time."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("images", type=Path)
    parser.add_argument("model", type=Path)
    parser.add_argument("--source", default="yolox-nano")
    parser.add_argument("--threads", type=int, default=2, help="runs of the stage at once")
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    paths = sorted(given.images.rglob("*.jpg"))
    card = card_of("segments", given.source)
    table = graph.class_table(card)
    simple = graph.load(card, given.model, table=table, threads=2, device="cpu")
    overlapped = graph.load(card, given.model, table=table, threads=1, device="cpu")
    loop(simple, paths[:10])
    stage(overlapped, paths[:10], given.threads)
    slow, fast, busy = [], [], []
    for _ in range(given.rounds):
        seconds, one = loop(simple, paths)
        slow.append(len(paths) / seconds)
        seconds, two, session = stage(overlapped, paths, given.threads)
        fast.append(len(paths) / seconds)
        busy.append(session / seconds)
        assert [s.label for s in one] == [s.label for s in two]
    rates = {"straightforward loop": slow, "detect stage": fast}
    base = statistics.median(slow)
    recording.table(
        "detect",
        f"Detection, {given.source}",
        ("way", "images/s", "times the loop"),
        [
            (name, round(statistics.median(r), 1), round(statistics.median(r) / base, 2))
            for name, r in rates.items()
        ],
        note=f"{len(paths)} images; a session ran {statistics.median(busy):.0%} of the time.",
        rounds=given.rounds,
    )
    print(f"{len(paths)} images, {given.rounds} rounds, medians")
    print(f"straightforward loop: {statistics.median(slow):6.1f} images/s")
    print(f"detect stage:         {statistics.median(fast):6.1f} images/s")
    print(f"ratio:                {statistics.median(fast) / statistics.median(slow):6.2f}")
    print(f"session busy:         {statistics.median(busy):6.0%} of the time")


if __name__ == "__main__":
    main()
