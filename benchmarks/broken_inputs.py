"""Feeds the stages 2,000 broken inputs made from real ones; every one must be accounted for.

    python benchmarks/broken_inputs.py [--count 2000] [--images DIR] [--model yolox_nano.onnx]

Four runs of the command line: images (through a detector if --model is given, else as the images of
a depth stage), label maps, released segment texts, depth files. A run must end with status 0, with
ok + failed + skipped = inputs; each failed row's reason must name its file, and no more of its path
than the dataset's root has below it; what was left whole must come out ok.
"""

import argparse
import os
import random
import re
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections import Counter
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from rsa_data.store.tables import WorkDir

NAMES = ("plain", "with space", "ünï-cødé", "<b>bold</b>", "=1+1", "-rf", "a'b\"c", "x;y", "%s%n")
WORDS = (
    "nan",
    "inf",
    "-0.5",
    "1e999",
    "1.0001",
    "0x1p-1",
    "",
    "०.५",
    "1,5",
    "--",
    "1e-400",
    "\x00",
)


def real_images(folder: Path | None, size: tuple[int, int] = (96, 72)) -> list[Image.Image]:
    """Some images to break: real ones below `folder`, or noise with a gradient."""
    found = sorted(folder.rglob("*.jpg")) + sorted(folder.rglob("*.png")) if folder else []
    images = []
    for path in found[:40]:
        try:
            images.append(Image.open(path).convert("RGB").resize(size))
        except OSError:
            continue
    if not images:
        rng = np.random.default_rng(0)
        ramp = np.linspace(0, 200, size[0])[None, :, None]
        for _ in range(10):
            noise = rng.integers(0, 55, (size[1], size[0], 3))
            images.append(Image.fromarray((noise + ramp).astype(np.uint8)))
    return images


def encoded(image: Image.Image, kind: str) -> bytes:
    buffer = BytesIO()
    image.save(buffer, kind)
    return buffer.getvalue()


def broken(data: bytes, how: str, chance: random.Random) -> bytes:
    """A file's bytes, broken in one of a few ways."""
    if how == "empty":
        return b""
    if how == "truncated":
        return data[: chance.randrange(1, len(data))]
    if how == "bits flipped":
        changed = bytearray(data)
        for _ in range(chance.choice((1, 3, 30))):
            changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
        return bytes(changed)
    if how == "noise":
        return chance.randbytes(chance.randrange(1, 3000))
    if how == "head only":
        return data[: chance.randrange(1, 40)]
    if how == "middle cut out":
        start = chance.randrange(len(data))
        return data[:start] + data[start + chance.randrange(1, 200) :]
    if how == "tail of another":
        return data + chance.randbytes(500)
    raise ValueError(how)


HOW = ("empty", "truncated", "bits flipped", "noise", "head only", "middle cut out")


def png_claiming(width: int, height: int, bits: int = 8, kind: int = 2) -> bytes:
    """A PNG whose header announces a size that its few bytes do not hold."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0))
    return (
        b"\x89PNG\r\n\x1a\n"
        + head
        + chunk(b"IDAT", zlib.compress(b"\0" * 999))
        + chunk(b"IEND", b"")
    )


def named(number: int) -> str:
    return f"{number:05d} {NAMES[number % len(NAMES)].replace('/', '-')}"


def write_images(folder: Path, count: int, images: list[Image.Image], chance: random.Random) -> set:
    """Broken images below a folder; returns the names of those that are whole."""
    whole = set()
    kinds = ("JPEG", "PNG", "WEBP", "BMP", "GIF", "TIFF")
    for number in range(count):
        path = folder / f"s{number % 7}" / f"{named(number)}.jpg"
        path.parent.mkdir(parents=True, exist_ok=True)
        image, how = chance.choice(images), number % 20
        data = encoded(image, chance.choice(kinds))
        if how == 0:
            path.write_bytes(data)
            whole.add(str(path.relative_to(folder)))
        elif how == 1:
            path.write_bytes(
                png_claiming(*chance.choice(((60_000, 60_000), (2**31 - 1, 1), (0, 9))))
            )
        elif how == 2:
            odd = chance.choice(("1", "L", "P", "LA", "RGBA", "CMYK", "I", "I;16", "F"))
            kind = "TIFF" if odd in ("F", "CMYK", "I") else "PNG"
            shape = chance.choice(((1, 1), (1, 300), (300, 1), (40, 30)))
            path.write_bytes(encoded(Image.new(odd, shape), kind))
        elif how == 3 and number % 3 == 0:
            path.symlink_to("nowhere.jpg")
        elif how == 3 and number % 3 == 1:
            os.mkfifo(path)
        elif how == 3:
            path.write_bytes(b"<html><script>alert(1)</script></html>")
        else:
            path.write_bytes(broken(data, HOW[number % len(HOW)], chance))
    return whole


def write_texts(folder: Path, count: int, chance: random.Random) -> set:
    """Broken files of the released kind; returns the keys of those that are whole."""
    whole = set()
    for number in range(count):
        path = folder / "nyu" / "train" / f"s{number % 7}" / f"{named(number)}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        good = "".join(
            f"{chance.choice(('bed', 'wall', 'tv'))} {chance.random():.6f}\n" for _ in "abcdef"
        )
        data, how = good.encode(), number % 12
        if how == 0:
            whole.add(f"s{number % 7}/{path.stem}")
        elif how == 1:
            data += f"chair {chance.choice(WORDS)}\n".encode()
        elif how == 2:
            data += chance.choice((b"\xff\xfe", "\udcff".encode("utf-8", "surrogatepass"), b"\xc3"))
        elif how == 3:
            data = b"x" * 300_000 + b" 0.5\n"
        elif how == 4:
            data = b"../../../etc/passwd 0.5\n<script> 0.1\n=cmd|' /C calc'!A0 0.1\n"
        elif how == 5:
            data = ("bed 0.001\n" * 20_000).encode()
        elif how == 6:
            data = good.replace("\n", chance.choice(("\r\n", "\r", "\x0b", "\u2028"))).encode()
        else:
            data = broken(data, HOW[number % len(HOW)], chance)
        path.write_bytes(data)
    return whole


def write_depths(root: Path, count: int, images: list[Image.Image], chance: random.Random) -> set:
    """Whole images whose ground truth or relative depth is broken."""
    whole = set()
    for folder in ("rgb", "depth", "relative/rgb"):
        (root / folder).mkdir(parents=True, exist_ok=True)
    for number in range(count):
        name = named(number)
        image = chance.choice(images)
        (root / "rgb" / f"{name}.png").write_bytes(encoded(image, "PNG"))
        shape = (image.height, image.width)
        metric = np.linspace(500, 9000, shape[0] * shape[1]).reshape(shape).astype(np.uint16)
        buffer = BytesIO()
        np.save(buffer, (1000 / metric).astype(np.float32))
        relative, depth = buffer.getvalue(), encoded(Image.fromarray(metric), "PNG")
        how = number % 15
        if how == 0:
            whole.add(f"rgb/{name}.png")
        elif how == 1:
            buffer = BytesIO()
            values = chance.choice(
                (
                    np.full(shape, np.nan, np.float32),
                    np.full(shape, np.inf),
                    np.full(shape, 1e30),
                    np.zeros((3, 4, 5)),
                    np.zeros((0, 5)),
                    np.array([["a"]]),
                    np.zeros(shape, np.complex64),
                )
            )
            np.save(buffer, values)
            relative = buffer.getvalue()
        elif how == 2:
            buffer = BytesIO()
            np.save(buffer, np.array([{"pickled": 1}], dtype=object), allow_pickle=True)
            relative = buffer.getvalue()
        elif how == 3:
            depth = png_claiming(60_000, 60_000, 16, 0)
        elif how == 4:
            depth = encoded(Image.new(chance.choice(("L", "RGB", "1")), image.size), "PNG")
        elif how == 5:
            depth = encoded(Image.fromarray(np.zeros(shape, np.uint16)), "PNG")
        elif how == 6:
            relative = relative[:128].replace(b"(72, 96)", b"(9999999, 9999999)")
        elif how == 7:
            # As many bytes in the header as before, so that it is read.
            relative = relative.replace(b"(72, 96), }        ", b"(99999, 99999), }  ")
        elif how < 11:
            depth = broken(depth, HOW[number % len(HOW)], chance)
        else:
            relative = broken(relative, HOW[number % len(HOW)], chance)
        (root / "depth" / f"{name}.png").write_bytes(depth)
        (root / "relative/rgb" / f"{name}.npy").write_bytes(relative)
    return whole


def write_labels(root: Path, count: int, images: list[Image.Image], chance: random.Random) -> set:
    """Whole images whose label maps are broken."""
    whole = set()
    (root / "images").mkdir(parents=True)
    (root / "labels").mkdir()
    for number in range(count):
        name = named(number)
        image = chance.choice(images)
        (root / "images" / f"{name}.png").write_bytes(encoded(image, "PNG"))
        labels = (np.arange(image.height * image.width) // 2000).reshape(image.height, -1)
        data = encoded(Image.fromarray(labels.astype(np.uint8)), "PNG")
        how = number % 8
        if how == 0:
            whole.add(f"images/{name}.png")
        elif how == 1:
            data = encoded(Image.new("L", (7, 5)), "PNG")
        elif how == 2:
            data = encoded(Image.new(chance.choice(("RGB", "RGBA", "1", "F")), image.size), "TIFF")
        elif how == 3:
            data = encoded(Image.new("I;16", image.size, 65535), "PNG")
        else:
            data = broken(data, HOW[number % len(HOW)], chance)
        if how != 7:
            (root / "labels" / f"{name}.png").write_bytes(data)
    return whole


def call(*words: object) -> tuple[int, str, float]:
    """Runs a command line to its end; status, output, seconds."""
    begun = time.monotonic()
    line = [sys.executable, "-m", "rsa_data", *map(str, words), "--max-failures", "100%"]
    ended = subprocess.run(line, capture_output=True, text=True, check=False, timeout=1200)
    return ended.returncode, ended.stdout + ended.stderr, time.monotonic() - begun


def check(
    work: WorkDir, dataset: str, table: str, whole: set, count: int, place: Path
) -> list[str]:
    """What is wrong with how the inputs were accounted for; prints the reasons."""
    problems: list[str] = []
    made, samples = work.table(dataset, table), work.table(dataset, "samples")
    totals: Counter = Counter()
    kinds: Counter = Counter()
    for number in samples.parts():
        receipt = made.receipt(number)
        totals.update({k: getattr(receipt, k) for k in ("ok", "failed", "skipped")})
        rows = made.read(number).select(["sample_id", "status", "error"]).to_pylist()
        images = dict(
            zip(*(samples.read(number)[c].to_pylist() for c in ("sample_id", "image")), strict=True)
        )
        for row in rows:
            key = row["sample_id"].split("/", 2)[2]
            good = images[row["sample_id"]] in whole or key in whole
            if good and row["status"] != "ok":
                problems.append(f"a whole input failed: {row}")
            if row["status"] == "ok":
                continue
            text = row["error"]
            stem = Path(images[row["sample_id"]] or key).stem
            if stem not in text:
                problems.append(f"does not name its file: {row}")
            if str(place) in text or re.search(r"0x[0-9a-f]{8,}", text):
                problems.append(f"tells of this machine or moment: {row}")
            kinds[
                re.sub(r"[\w./<>='\";%()\- ]*" + re.escape(stem) + r"[\w.]*", "FILE", text)[:70]
            ] += 1
    if sum(totals.values()) != count:
        problems.append(f"expected {count} inputs accounted for, found {dict(totals)}")
    print(f"  {dict(totals)}, {len(kinds)} kinds of reasons; the most frequent:")
    for kind, times in kinds.most_common(3):
        print(f"    {times:4} x {kind}")
    return problems


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--images", type=Path, help="folder of real images to break")
    parser.add_argument("--model", type=Path, help="yolox_nano.onnx")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    chance = random.Random(given.seed)
    images = real_images(given.images)
    each = given.count // 4
    bad = 0
    with tempfile.TemporaryDirectory(prefix="rsa-data-broken-") as name:
        base = Path(name)
        work = WorkDir(base / "work")
        at = ("--work", base / "work")

        def judge(
            what: str, ended: tuple[int, str, float], dataset: str, table: str, whole: set
        ) -> int:
            status, output, seconds = ended
            print(f"{what}: {each} inputs, {len(whole)} whole; status {status}, {seconds:.0f} s")
            if status != 0:
                print(output[-3000:])
                return 1
            found = check(work, dataset, table, whole, each, base)
            for problem in found[:8]:
                print("  PROBLEM", problem)
            return len(found)

        whole = write_images(base / "images", each, images, chance)
        if given.model:
            source = ("--segments", "yolox-nano", "--segmenter-weights", given.model)
        else:
            source = ("--segments", f"labels:{base}/images/{{path}}.jpg", "--names", "nyu13")
            whole = set()
        ended = call(
            "detect", "--dataset", "folder:images", "--root", base / "images", *source, *at
        )
        table = "segments/yolox-nano" if given.model else "segments/labels"
        bad += judge("images", ended, "images", table, whole)

        whole = write_labels(base / "maps", each, images, chance)
        source = ("--segments", f"labels:{base}/maps/labels/{{stem}}.png", "--names", "nyu13")
        options = ("--dataset-option", "images=images")
        ended = call(
            "detect", "--dataset", "folder:maps", "--root", base / "maps", *options, *source, *at
        )
        bad += judge("label maps", ended, "maps", "segments/labels", whole)

        whole = write_texts(base / "texts", each, chance)
        source = ("--segments", f"rsa-release:{base / 'texts'}")
        ended = call("captions", "--dataset", "nyuv2", *source, *at)
        bad += judge("texts", ended, "nyuv2", "segments/rsa-release", whole)

        whole = write_depths(base / "depths", each, images, chance)
        options = tuple(
            word
            for pair in ("images=rgb", "depth=depth", "depth_unit=mm")
            for word in ("--dataset-option", pair)
        )
        model = ("--depth-model", f"files:{base / 'depths/relative'}")
        ended = call(
            "depth", "--dataset", "folder:depths", "--root", base / "depths", *options, *model, *at
        )
        bad += judge("depth", ended, "depths", "depth/files-relative", whole)
    print(f"{4 * each} broken inputs, {bad} problems")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
