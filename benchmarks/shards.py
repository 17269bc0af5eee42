"""Images in tar shards against loose files, through the same web server on this machine.

    python benchmarks/shards.py [--images 200000] [--few 20000] [--loose 3000] [--a-shard 1000]

Small images (64 x 48 px JPEG) in tars are indexed, segmented by a stub network (its answer is the
picture) and captioned, through a server that sends spans. What only reads tables follows:
embed-objects with the shipped MiniLM, verify and status. Each command is a process of its own.

Memory: --few images and --images of them in tars (0 leaves this out). Speed: --loose images as
loose files and in tars, in turns, two of each, by the time that each answer of the server waits (0
leaves this out). The server, the network and the disk are this machine's: what is compared is
requests, not a link.
"""

import argparse
import contextlib
import functools
import http.server
import io
import multiprocessing
import re
import sys
import tarfile
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

import recording
from own_models import CARD, write_semantic

COMMANDS = ("detect", "captions", "embed-objects", "verify", "status")
LATENCIES = (0, 10, 30)  # ms that each answer waits: none, and what object stores take


class Ranges(http.server.SimpleHTTPRequestHandler):
    """Lists folders and sends spans of files."""

    protocol_version = "HTTP/1.1"
    latency = 0.0  # seconds that each answer waits

    def send_head(self):
        time.sleep(self.latency)
        span = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        path = Path(self.translate_path(self.path))
        if span is None or not path.is_file():
            return super().send_head()
        with path.open("rb") as file:
            file.seek(int(span[1]))
            data = file.read(int(span[2]) + 1 - int(span[1]))
        self.send_response(206 if data else 416)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)
        return None

    def log_message(self, *_: object) -> None:
        pass


def serve(folder: Path, latency: float, ready) -> None:
    handler = functools.partial(type("Far", (Ranges,), {"latency": latency}), directory=folder)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        ready.send(server.server_address[1])
        server.serve_forever()


def pictures(count: int) -> list[bytes]:
    rng = np.random.default_rng(0)
    made = []
    for _ in range(count):
        file = io.BytesIO()
        blocks = rng.integers(0, 255, (6, 8, 3), np.uint8).repeat(8, 0).repeat(8, 1)
        Image.fromarray(blocks).save(file, "JPEG")
        made.append(file.getvalue())
    return made


def write(folder: Path, images: int, a_shard: int, loose: int) -> None:
    made = pictures(997)
    (folder / "tars").mkdir()
    for first in range(0, images, a_shard):
        with tarfile.open(folder / "tars" / f"{first // a_shard:05d}.tar", "w") as tar:
            for number in range(first, min(first + a_shard, images)):
                data = made[number % len(made)]
                info = tarfile.TarInfo(f"{number:09d}.jpg")
                info.size = len(data)
                tar.addfile(info, io.BytesIO(data))
    for number in range(loose):
        path = folder / "loose" / f"{number // a_shard:05d}" / f"{number:09d}.jpg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(made[number % len(made)])


def measured(*words: object) -> tuple[float, float]:
    """Seconds and peak MB of a command."""
    _, seconds, peak, _ = recording.spent([sys.executable, "-m", "rsa_data", *map(str, words)])
    return seconds, peak


def chain(
    folder: Path, address: str, choice: str, name: str, commands: tuple[str, ...], *how: object
) -> dict[str, tuple[float, float]]:
    """Seconds and MB of each command over a root; name : of the work dir."""
    where = ("--dataset", choice, "--root", address, *how)
    stub = ("--card", folder / "stub.toml", "--segmenter-weights", folder / "stub.onnx")
    words = {
        "detect": (*where, *stub, "--segments", "stub"),
        "captions": ("--dataset", "photos", "--segments", "stub"),
        "embed-objects": ("--dataset", "photos", "--encoder", "minilm"),
        "verify": (),
        "status": (),
    }
    work = folder / f"work-{name}"
    found = {c: measured(c, *words[c], "--work", work) for c in commands}
    print(name, found, flush=True)
    return found


def memory(folder: Path, address: str, few: int, many: int, a_shard: int) -> None:
    """Peak memory of each command over few and many images."""
    listed = folder / "few.txt"
    listed.write_text("".join(f"{i:05d}.tar\n" for i in range(few // a_shard)))
    how = ("--dataset-option", f"file_list={listed}")
    place = f"{address}/tars"
    small = chain(folder, place, "webdataset:photos", "few", COMMANDS, *how)
    large = chain(folder, place, "webdataset:photos", "many", COMMANDS)
    recording.table(
        "shards",
        "Peak memory over images in tars",
        ["command", f"MB, {few:,} images", f"MB, {many:,} images", "ratio"],
        [
            [c, round(small[c][1]), round(large[c][1]), round(large[c][1] / small[c][1], 3)]
            for c in COMMANDS
        ],
        note=f"64 x 48 px JPEG, {a_shard:,} in a tar, through a web server on this machine; detect "
        "includes the index. Wanted: at most 1.1.",
    )


def speed(folder: Path, images: int, a_shard: int) -> None:
    """Index and detect of the same images as loose files and in tars, in turns, by latency."""
    listed = folder / "speed.txt"
    listed.write_text("".join(f"{i:05d}.tar\n" for i in range(images // a_shard)))
    ways = (
        ("loose files", "folder:photos", "loose", ()),
        ("tars", "webdataset:photos", "tars", ("--dataset-option", f"file_list={listed}")),
    )
    rows = []
    for latency in LATENCIES:
        rates: dict[str, list[float]] = {name: [] for name, *_ in ways}
        with server(folder, latency / 1000) as address:
            for turn in range(2):
                for name, choice, place, more in ways:
                    work = f"{place}-{latency}-{turn}"
                    found = chain(folder, f"{address}/{place}", choice, work, ("detect",), *more)
                    rates[name].append(images / found["detect"][0])
        loose, tars = (sum(each) / len(each) for each in rates.values())
        each = (round(rate) for rate in (*rates["loose files"], *rates["tars"]))
        rows.append([f"{latency} ms", *each, round(tars / loose, 2)])
    recording.table(
        "shards",
        "Index and detect: images a second",
        ["an answer waits", "loose, first turn", "loose, second", "tars, first turn",
         "tars, second", "tars against loose"],
        rows,
        note=f"{images:,} images of 64 x 48 px, a stub network, default options; starting the "
        "command is in the figures. Wanted: at least 3.",
    )  # fmt: skip


@contextlib.contextmanager
def server(folder: Path, latency: float) -> Iterator[str]:
    """The address of a server whose every answer waits `latency` seconds."""
    mine, theirs = multiprocessing.Pipe()
    process = multiprocessing.Process(target=serve, args=(folder, latency, theirs), daemon=True)
    process.start()
    try:
        yield f"http://127.0.0.1:{mine.recv()}"
    finally:
        process.terminate()
        process.join()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=200_000)
    parser.add_argument("--few", type=int, default=20_000)
    parser.add_argument("--loose", type=int, default=3_000)
    parser.add_argument("--a-shard", type=int, default=1000)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rsa-data-shards-") as name:
        folder = Path(name)
        write(folder, max(given.images, given.loose), given.a_shard, given.loose)
        write_semantic(folder / "stub.onnx")
        (folder / "stub.toml").write_text(CARD)
        if given.loose:
            speed(folder, given.loose, given.a_shard)
        if given.images:
            with server(folder, 0.002) as address:
                memory(folder, address, given.few, given.images, given.a_shard)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
