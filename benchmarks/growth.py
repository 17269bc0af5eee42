"""CPU time and peak memory of commands as a work dir grows, without those that run models.

    python benchmarks/growth.py [--rows 10000,100000,1000000] [--folder DIR] [--more]

Synthetic Parquet files of 2,000 images each (a few bytes stand for a picture) are indexed; segments
and pixels of relative and metric depth are written straight into the work dir, the same ones in
each part. Then every command runs in a process of its own, on one thread: captions, embed-objects,
train-head (one epoch of the head `objects` in windows of 64 MB), evaluate (a hundredth as many test
maps of 24x32), verify, status, report and export. Figures go to docs/performance.md with a chart.

--more : keep the figures of other numbers of rows that an earlier run has recorded.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

sys.path.insert(0, str(Path(__file__).parent))

import recording

from rsa_data.common import svg
from rsa_data.runner.fingerprints import part_fingerprint
from rsa_data.store import schemas
from rsa_data.store.tables import Description, Made, WorkDir

PART, SIZE = 2000, (24, 32)
TOP, WIDE, HIGH = 50, 290, 250  # px, of a panel of the chart
LABELS = ("bed", "chair", "lamp", "picture", "wall", "window", "desk", "rug", "door", "book")
# What the others stand on, without the command line around it.
INDEX = (
    "import sys; from pathlib import Path; from rsa_data.runner import chains; "
    "from rsa_data.store.tables import WorkDir; "
    "chains.samples(WorkDir(sys.argv[1]), 'parquet:photos', {}, root=Path(sys.argv[2]))"
)
COMMANDS: dict[str, tuple[str, ...]] = {
    "captions": ("captions", "--dataset", "photos", "--segments", "made", "--variants", "2"),
    "embed-objects": ("embed-objects", "--encoder", "minilm"),
    "train-head": ("train-head", "--head", "objects", "--epochs", "1", "--memory", "0.0625",
                   "--threads", "1"),
    "evaluate": ("evaluate", "--head", "head"),
    "verify": ("verify",),
    "status": ("status",),
    "report": ("report", "--out", "{folder}/report.html"),
    "export": ("export", "--embeddings", "images/made", "--out", "{folder}/export"),
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rows", default="10000,100000,1000000")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--more", action="store_true")
    given = parser.parse_args()
    rows: list[list[Any]] = earlier() if given.more else []
    for count in map(int, given.rows.split(",")):
        place: Any = given.folder and nullcontext(given.folder / str(count))
        with place or tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            folder.mkdir(parents=True, exist_ok=True)
            rows = [row for row in rows if row[1] != count] + measure(folder, count)
        rows.sort(key=lambda row: (["index", *COMMANDS].index(row[0]), row[1]))
        recording.table(
            "growth",
            "Growth",
            ("command", "images", "CPU s", "CPU us an image", "peak MB"),
            rows,
            note="One process and one thread each. CPU seconds, since other work ran beside it. "
            "Memory grows in two commands: index keeps a digest of each id, about 40 bytes an "
            "image, and evaluate the measures of all methods, 9 kB a test image.",
            packages=("duckdb",),
        )
        chart(rows)


def measure(folder: Path, count: int) -> list[list[Any]]:
    """Rows of the table for one number of images."""
    work = WorkDir(str(folder / "work"))
    pictures(folder / "files", count)
    found = []

    def one(name: str, command: list[str]) -> None:
        cpu, _, megabytes, _ = recording.spent(command, {"OMP_NUM_THREADS": "1"})
        found.append([name, count, round(cpu, 2), round(1e6 * cpu / count, 1), round(megabytes)])
        print(*found[-1], flush=True)

    one("index", [sys.executable, "-c", INDEX, work.store.location, str(folder / "files")])
    tables(work)
    for name, words in COMMANDS.items():
        given = [word.format(folder=folder) for word in words]
        one(name, [sys.executable, "-m", "rsa_data", *given, "--work", work.store.location])
    return found


def pictures(folder: Path, count: int) -> None:
    """Parquet files with a column of images, train-NNNNN.parquet, and one of test images."""
    folder.mkdir(exist_ok=True)
    kind = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
    test = max(4, count // 100)
    for split, images in (("train", count), ("test", test)):
        for first in range(0, images, PART):
            paths = [f"room{i // 100}/{i:07d}.jpg" for i in range(first, min(first + PART, images))]
            rows = [{"bytes": b"\xff\xd8\xff", "path": f"{split}/{path}"} for path in paths]
            table = pa.table({"image": pa.array(rows, kind)})
            pq.write_table(table, folder / f"{split}-{first // PART:05d}.parquet")


def tables(work: WorkDir) -> None:
    """Segments, depth and features of every part: the same rows under the samples' names."""
    samples = work.table("photos", "samples")
    kinds: dict[str, tuple[str, str, dict[str, Any], Callable[[int, str], pa.Table]]] = {
        "segments/made": ("made", "segments", {}, segments),
        "depth/files": ("depth", "depth", DEPTH, depth),
        "embeddings/images/made": ("made", "image_embeddings", {}, features),
    }
    for name, (stage, schema, options, make) in kinds.items():
        table = work.table("photos", name)
        about = Description(stage=stage, stage_version=1, schema=schema, options=options,
                            inputs=["samples"], files={})  # fmt: skip
        table.bind(about)
        made: dict[tuple[int, str], pa.Table] = {}
        for number in samples.parts():
            receipt = samples.receipt(number)
            key = receipt.rows, receipt.split
            if key not in made:
                made[key] = make(*key)
            ids = samples.read(number, ["sample_id"])["sample_id"]
            place = made[key].schema.get_field_index("sample_id")
            content = made[key].set_column(place, made[key].schema.field(place), ids)
            inputs = {"samples": receipt.digest}
            counts = {"ok": receipt.rows, "failed": 0, "skipped": 0, "split": receipt.split}
            follows = part_fingerprint(about, inputs)
            table.commit(number, content, Made(**counts, inputs=inputs, fingerprint=follows))
        table.manifest(samples.parts())


DEPTH = {"depth_model": "files", "files_hold": "relative", "geometry": None, "crop": "none"}


def segments(rows: int, split: str) -> pa.Table:
    """Six objects an image."""
    rng = np.random.default_rng(rows)
    names = schemas.schema("segments").names
    columns: dict[str, Any] = {name: [None] * rows for name in names}
    columns["sample_id"], columns["status"] = [""] * rows, ["ok"] * rows
    columns["label"] = [[LABELS[k] for k in row] for row in rng.integers(0, 10, (rows, 6))]
    columns["area"] = np.round(rng.uniform(0.01, 0.15, (rows, 6)), 4).tolist()
    columns["score"], columns["is_thing"] = [[1.0] * 6] * rows, [[True] * 6] * rows
    return schemas.from_columns("segments", columns)


def depth(rows: int, split: str) -> pa.Table:
    """256 pixels of an image to train on, whole maps of the test split."""
    rng = np.random.default_rng(rows)
    pixels = SIZE[0] * SIZE[1] if split == "test" else 256
    columns: dict[str, Any] = {n: [None] * rows for n in schemas.schema("depth").names}
    y = rng.uniform(0, 10, (rows, pixels))
    scale, shift = 0.05 * rng.uniform(1, 3, rows), 0.1 * rng.uniform(1, 3, rows)
    metres = 1 / (scale[:, None] * y + shift[:, None])
    columns["sample_id"], columns["status"] = [""] * rows, ["ok"] * rows
    columns["kind"] = ["map" if split == "test" else "pixels"] * rows
    if split == "test":
        columns["height"], columns["width"] = [SIZE[0]] * rows, [SIZE[1]] * rows
    columns["n_valid"], columns["repeated"] = [pixels] * rows, [False] * rows
    columns["relative"] = [row.astype("<f2").tobytes() for row in y]
    columns["metric"] = [row.astype("<f2").tobytes() for row in metres]
    columns["fit_scale"], columns["fit_shift"] = scale, shift
    return schemas.from_columns("depth", columns)


def features(rows: int, split: str) -> pa.Table:
    """A feature of 384 numbers for each image, as export writes them."""
    values = np.random.default_rng(rows).normal(size=(rows, 384)).astype(np.float16)
    columns: dict[str, Any] = {n: [None] * rows for n in schemas.schema("image_embeddings").names}
    columns["sample_id"], columns["status"] = [""] * rows, ["ok"] * rows
    columns["embedding"] = schemas.embedding_column(values)
    return schemas.from_columns("image_embeddings", columns)


def earlier() -> list[list[Any]]:
    file = recording.RESULTS / "growth.json"
    return json.loads(file.read_text())["Growth"]["rows"] if file.is_file() else []


def chart(rows: list[list[Any]]) -> None:
    """docs/img/growth.svg: CPU seconds and peak memory over the number of images."""
    names = list(dict.fromkeys(row[0] for row in rows))
    parts: list[str] = []
    for panel, (column, title) in enumerate(((2, "CPU seconds"), (4, "peak memory, MB"))):
        left = 60 + 420 * panel
        exponents = [np.log10([row[k] for row in rows]) for k in (1, column)]
        low, far = ([np.floor(e.min()), np.ceil(e.max() + 1e-9)] for e in exponents)

        def place(images: float, value: float, low=low, far=far, left=left) -> tuple[float, float]:
            x = (np.log10(images) - low[0]) / max(low[1] - low[0], 1)
            y = (np.log10(max(value, 10 ** far[0])) - far[0]) / max(far[1] - far[0], 1)
            return left + WIDE * x, TOP + HIGH * (1 - y)

        for power in np.arange(far[0], far[1] + 1):
            y = place(10 ** low[0], 10**power)[1]
            parts += [svg.rule(left, y, left + WIDE, y)]
            parts += [svg.label(left - 6, y + 4, svg.short(float(10**power)), "end")]
        for power in np.arange(low[0], low[1] + 1):
            x = place(10**power, 10 ** far[0])[0]
            parts.append(svg.label(x, TOP + HIGH + 18, svg.short(float(10**power))))
        parts.append(svg.label(left + WIDE / 2, TOP + HIGH + 38, f"images; {title}"))
        for series, name in enumerate(names):
            points = [place(row[1], row[column]) for row in rows if row[0] == name]
            parts += [svg.path(points, series), *(svg.mark(*p, series) for p in points)]
    for series, name in enumerate(names):
        y = 60 + 22 * series
        parts += [svg.mark(795, y - 4, series), svg.label(808, y, name, "start")]
    title = "CPU time and memory of commands over the size of a work dir"
    target = Path(__file__).parents[1] / "docs" / "img" / "growth.svg"
    target.write_text(svg.document(title, (920, 360), parts))


if __name__ == "__main__":
    begun = time.monotonic()
    main()
    print(f"{time.monotonic() - begun:.0f} s")
