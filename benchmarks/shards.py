"""Images in tar shards against loose files, through the same web server on this machine.

    python benchmarks/shards.py [--images 200000] [--few 20000] [--loose 5000] [--a-shard 1000]
        [--out benchmarks/results/shards.json]

Small images (64 x 48 px JPEG) in tars are indexed, segmented by a stub network (its answer is the
picture) and captioned, through a server that sends spans, once with --images, once with --few of
them; then --loose of the same images as loose files. What only reads tables follows: embed-objects
with the shipped MiniLM, verify and status. Each command is a process of its own. Printed are
seconds, images a second and peak memory of each, the ratio of memory of many to few, and the ratio
of images a second of tars to loose files in detect. The server, the network and the disk are this
machine's: what is compared is requests, not a link.
"""

import argparse
import functools
import http.server
import io
import json
import multiprocessing
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from own_models import CARD, write_semantic

LATENCY = 0.002  # seconds that each answer waits, as a server nearby would take


class Ranges(http.server.SimpleHTTPRequestHandler):
    """Lists folders and sends spans of files."""

    protocol_version = "HTTP/1.1"

    def send_head(self):
        time.sleep(LATENCY)
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


def serve(folder: str, ready) -> None:
    handler = functools.partial(Ranges, directory=folder)
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
    begun = time.monotonic()
    process = subprocess.Popen([sys.executable, "-m", "rsa_data", *map(str, words)],
                               stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)  # fmt: skip
    assert process.stderr is not None
    said = process.stderr.read().decode()
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{words}: status {status}\n{said}")
    return time.monotonic() - begun, usage.ru_maxrss / 1000


def chain(folder: Path, address: str, choice: str, images: int, *how: object) -> dict[str, float]:
    """Seconds and MB of each command over so many images."""
    work = folder / f"work-{choice.partition(':')[0]}-{images}"
    where = ("--dataset", choice, "--root", address, *how)
    stub = ("--card", folder / "stub.toml", "--segmenter-weights", folder / "stub.onnx")
    commands = {
        "detect": (*where, *stub, "--segments", "stub"),
        "captions": ("--dataset", "photos", "--segments", "stub"),
        "embed-objects": ("--dataset", "photos", "--encoder", "minilm"),
        "verify": (),
        "status": (),
    }
    found: dict[str, float] = {"images": images}
    for name, words in commands.items():
        seconds, megabytes = measured(name, *words, "--work", work)
        found |= {f"{name}, s": round(seconds, 1), f"{name}, MB": round(megabytes)}
    found["images a second"] = round(images / found["detect, s"], 1)
    print(choice, json.dumps(found), flush=True)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=200_000)
    parser.add_argument("--few", type=int, default=20_000)
    parser.add_argument("--loose", type=int, default=5_000)
    parser.add_argument("--a-shard", type=int, default=1000)
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    given = parser.parse_args()
    machine = f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before this began"
    print(machine)
    with tempfile.TemporaryDirectory(prefix="rsa-data-shards-") as name:
        folder = Path(name)
        write(folder, given.images, given.a_shard, given.loose)
        write_semantic(folder / "stub.onnx")
        (folder / "stub.toml").write_text(CARD)
        mine, theirs = multiprocessing.Pipe()
        server = multiprocessing.Process(target=serve, args=(name, theirs), daemon=True)
        server.start()
        address = f"http://127.0.0.1:{mine.recv()}"
        few = folder / "few.txt"
        few.write_text("".join(f"{i:05d}.tar\n" for i in range(given.few // given.a_shard)))
        listed = ("--dataset-option", f"file_list={few}")
        runs = {
            "loose": chain(folder, f"{address}/loose", "folder:photos", given.loose),
            "few": chain(folder, f"{address}/tars", "webdataset:photos", given.few, *listed),
            "many": chain(folder, f"{address}/tars", "webdataset:photos", given.images),
        }
        server.terminate()
        server.join()
    memory = {
        name.removesuffix(", MB"): round(runs["many"][name] / runs["few"][name], 3)
        for name in runs["many"]
        if name.endswith(", MB")
    }
    faster = runs["few"]["images a second"] / runs["loose"]["images a second"]
    print(f"memory of {given.images:,} against {given.few:,} images: {memory}")
    print(f"images a second of tars against loose files: {faster:.2f}")
    if given.out is not None:
        made = {"machine": machine, "runs": runs, "memory of many to few": memory}
        made["images a second of tars to loose files"] = round(faster, 2)
        given.out.write_text(json.dumps(made, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
