"""Peak memory of captions and embed when ten times as many rows pass through.

    python benchmarks/scale.py [--rows 100000 1000000]

Each size runs in a fresh process: random segments of a tenth of a row's image each (14 segments an
image, 5 captions), then `captions` and `embed` as the commands run them, with CLIP's tokenizer and
real sizes (1024 float16 values a text) but a stub in place of the network. Only tables pass
through, so memory should follow the part and not their number.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import torch

from rsa_data import pipeline, registry, tables
from rsa_data.encoders import Encoder, TextModel
from rsa_data.encoders.batches import LENGTH_AXES, by_length
from rsa_data.encoders.tokenizers import clip
from rsa_data.parts import Work

PART, VARIANTS, DIM = 5000, 5, 1024
NAMES = ("bed", "chair", "traffic light", "car", "wall", "floor", "sink", "potted plant", "sky")


class Stub(torch.nn.Module):
    """A feature that costs nothing and is not zero."""

    def forward(self, ids: torch.Tensor, lengths: torch.Tensor) -> torch.Tensor:
        return (ids.sum(1, keepdim=True) % 97 + 1).float() * torch.linspace(0.1, 1, DIM)


def load(files: dict[str, Path]) -> TextModel:
    return TextModel(Stub(), clip().encode, by_length, 65536, LENGTH_AXES, DIM, False)


STUB = Encoder("A stub.", lambda argument, weights: {}, load)


def segments(first: int, rng: np.random.Generator) -> tuple[pa.Table, pa.Table]:
    """Samples and segments of one part."""
    ids = [f"nyuv2/train/{first + i:09d}" for i in range(PART)]
    counts = rng.integers(4, 25, PART)
    total = int(counts.sum())
    offsets = pa.array(np.concatenate([[0], np.cumsum(counts)]), pa.int32())

    def lists(values: pa.Array) -> pa.Array:
        return pa.ListArray.from_arrays(offsets, values)

    labels = pa.array(NAMES).take(pa.array(rng.integers(0, len(NAMES), total)))
    blank: dict[str, list] = {n: [None] * PART for n in tables.schema("segments").names}
    found = blank | {
        "sample_id": ids,
        "status": ["ok"] * PART,
        "label": lists(labels),
        "score": lists(pa.array(np.ones(total, np.float32))),
        "area": lists(pa.array(rng.uniform(0.001, 0.05, total))),
        "is_thing": lists(pa.array(np.ones(total, bool))),
    }
    blank = {n: [None] * PART for n in tables.schema("samples").names}
    rows = {"sample_id": ids, "dataset": ["nyuv2"] * PART, "split": ["train"] * PART}
    samples = blank | rows | {"scene": [f"scene {i % 50}" for i in range(PART)]}
    return tables.from_columns("samples", samples), tables.from_columns("segments", found)


def run(rows: int, folder: str) -> None:
    """Writes the input, runs both stages, prints seconds and peak memory."""
    registry.ENCODERS["stub"] = f"{__name__}:STUB"
    work, rng = Work(folder), np.random.default_rng(0)
    made = {name: work.table("nyuv2", name) for name in ("samples", "segments/random")}
    for schema, table in zip(("samples", "segments"), made.values(), strict=True):
        about = {"stage_version": 1, "options": {"dataset": "nyuv2", "source": "random"}}
        inputs = [] if schema == "samples" else ["samples"]
        table.bind({"stage": schema, "schema": schema, "inputs": inputs, "files": {}, **about})
    for number in range(rows // (PART * VARIANTS)):
        parts = segments(number * PART, rng)
        for table, part in zip(made.values(), parts, strict=True):
            receipt = {"ok": PART, "failed": 0, "skipped": 0, "split": "train", "inputs": {}}
            table.commit(number, part, receipt | {"fingerprint": "random"})
    for table in made.values():
        table.manifest(table.parts())
    silent = SimpleNamespace(update=lambda n: None, close=lambda: None)
    how = pipeline.How(bar=lambda *_: silent, tell=lambda *_: None)
    begun = time.perf_counter()
    pipeline.captions(work, "nyuv2", {}, how, segments=None, detect={})
    between = time.perf_counter()
    pipeline.embed(work, "nyuv2", {"encoder": "stub", "runtime": "torch", "threads": 1}, how)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(between - begun, time.perf_counter() - between, peak)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rows", type=int, nargs=2, default=(100_000, 1_000_000))
    parser.add_argument("--only", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--folder", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.only:
        run(given.only, given.folder)
        return
    peaks = []
    for rows in given.rows:
        with tempfile.TemporaryDirectory() as folder:
            call = [sys.executable, __file__, "--only", str(rows), "--folder", folder]
            out = subprocess.run(call, check=True, capture_output=True, text=True).stdout
            captions, embed, peak = map(float, out.split())
            size = sum(f.stat().st_size for f in Path(folder).rglob("*.parquet")) / 1e6
        peaks.append(peak)
        print(
            f"{rows:,} rows: captions {captions:.1f} s, embed {embed:.1f} s, peak {peak:.0f} MB, "
            f"{size:.0f} MB of tables"
        )
    print(f"peak memory: {peaks[1] / peaks[0]:.2f} times (goal: at most 1.1)")


if __name__ == "__main__":
    main()
