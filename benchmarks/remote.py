"""Images a second of the detect stage from a web server far away, against a folder.

    python benchmarks/remote.py IMAGES MODEL.onnx [--source yolox-nano] [--latency 0.05]

A server on this machine waits `--latency` seconds before each answer, as one some countries away
does. Compared are, in alternating rounds: the images in their folder; the same over the network
with as many readers as the stage takes there; and over the network one after the other. What is
found must be the same.
"""

import argparse
import functools
import http.server
import statistics
import subprocess
import sys
import time
from pathlib import Path

import recording

from rsa_data.common.cards import card_of
from rsa_data.datasets.images import read_image
from rsa_data.datasets.roots import open_root, readers
from rsa_data.segments import graph, onnx


class Far(http.server.SimpleHTTPRequestHandler):
    """Files, each after a while."""

    protocol_version = "HTTP/1.1"
    latency = 0.0

    def do_GET(self):
        time.sleep(self.latency)
        super().do_GET()

    def log_message(self, *_):
        pass


def serve(folder, latency):
    """Serves a folder, and prints the port that it listens on."""
    Far.latency = latency
    handler = functools.partial(Far, directory=folder)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        print(server.server_address[1], flush=True)
        server.serve_forever()


def detect(detector, root, names, helpers):
    """Seconds, and what was found."""
    start = time.perf_counter()

    def read(name):
        return detector.prepare(read_image(root / name))

    found = list(onnx.detect(detector, read, names, threads=2, helpers=helpers))
    return time.perf_counter() - start, [repr(f) for f in found]


def main():
    """Measures all three and prints images a second and ratios."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("images", type=Path)
    parser.add_argument("model", type=Path)
    parser.add_argument("--source", default="yolox-nano")
    parser.add_argument("--latency", type=float, default=0.05)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.serve:
        return serve(args.images, args.latency)
    given = [args.images, args.model, "--latency", str(args.latency), "--serve"]
    server = subprocess.Popen([sys.executable, __file__, *given], stdout=subprocess.PIPE, text=True)
    try:
        root = open_root(f"http://127.0.0.1:{int(server.stdout.readline())}")
        endings = (".jpg", ".png")
        names = [p.name for p in sorted(args.images.iterdir()) if p.name.endswith(endings)]
        names = [name for name in names if "depth" not in name]
        detector = graph.load(
            card_of("segments", args.source),
            args.model,
            table=graph.class_table(card_of("segments", args.source)),
        )
        ways = {
            "folder": (args.images, readers(args.images)),
            f"{readers(root)} readers": (root, readers(root)),
            "1 reader": (root, 1),
        }
        rates, results = {name: [] for name in ways}, []
        for _ in range(args.rounds):
            for name, (place, helpers) in ways.items():
                seconds, found = detect(detector, place, names, helpers)
                rates[name].append(len(names) / seconds)
                results.append(found)
    finally:
        server.kill()
        server.wait()
    same = all(found == results[0] for found in results)
    print(f"{len(names)} images, {args.latency * 1000:.0f} ms before each answer; same: {same}")
    medians = {name: statistics.median(values) for name, values in rates.items()}
    recording.table(
        "remote",
        "Detection over HTTP",
        ("images from", "images/s", "share of a folder's"),
        [(n, round(m, 1), round(m / medians["folder"], 2)) for n, m in medians.items()],
        note=f"{len(names)} images, {args.latency * 1000:.0f} ms before each answer; results are "
        f"{'the same' if same else 'not the same'}.",
        rounds=args.rounds,
    )
    for name, median in medians.items():
        print(f"  {name:12} {median:7.1f} images/s  {median / medians['folder']:.2f} of a folder")
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
