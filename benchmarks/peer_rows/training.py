"""Training a head, and reading features and pixels into torch."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from made_tables import write
from train import BATCH, CLIP, END, LR, PIXELS, examples

from rsa_data.heads.checkpoint import ScaleHead
from rsa_data.store.tables import WorkDir

from .ways import Given, Row, Run, Way, ours, peer

_EPOCHS = 4


def training(given: Given) -> Row:
    """`train-head` from a work dir against plain PyTorch from the same Parquet files."""
    work, count = tables(given)
    location = Path(work.store.location)
    recipe = {"batch": BATCH, "pixels": PIXELS, "lr": LR, "end-lr": END, "clip": CLIP, "warmup": 0}
    recipe |= {"epochs": _EPOCHS, "threads": given.threads, "name": "peer"}

    def own(precision: str) -> Run:
        words = [word for name, value in recipe.items() for word in (f"--{name}", value)]
        words += ["--precision", precision, "--start-over"]
        used = ours(given, location, "train-head", *words)
        head = ScaleHead.load(f"{location}/heads/peer")
        validation: Any = head.about.validation
        return Run(used[0], float("nan"), *used[1:], validation.abs_rel["nyuv2"])

    def theirs() -> Run:
        read = lambda path: json.loads(path.read_text())  # noqa: E731
        words = {"epochs": _EPOCHS, "files": files(work)}
        return peer(given, "training", python=sys.executable, read=read, **words)

    ways = (
        Way("plain PyTorch", theirs),
        Way("rsa-data, float32", lambda: own("float32"), ours=True),
        Way("rsa-data, bfloat16", lambda: own("bfloat16"), ours=True),
    )
    note = (
        f"mlp5 on made-up features of 1024 numbers, batches of {BATCH}, {PIXELS} pixels an image, "
        f"{_EPOCHS} epochs of Adam, the same held-out scenes."
    )

    def said(found: Any) -> dict[str, str]:
        return {name: f"AbsRel {error:.4f} on the held-out scenes" for name, error in found.items()}

    return Row("Training a head", _EPOCHS * count, "images", ways, said, note)


def reading(given: Given) -> Row:
    """One epoch of shuffled batches of features and pixels as tensors."""
    work, count = tables(given)
    prepared = given.folder / "readers"
    peer(given, "reading", python=sys.executable, read=str, way="prepare", files=files(work),
         folder=prepared)  # fmt: skip
    location = work.store.location

    def one(way: str) -> Callable[[], Run]:
        read = lambda path: np.array(json.loads(path.read_text()))  # noqa: E731
        words = {"way": way, "folder": prepared, "work": location, "batch": BATCH}
        return lambda: peer(given, "reading", python=sys.executable, read=read, **words)

    ways = (
        Way("datasets", one("index")),
        Way("webdataset", one("webdataset")),
        Way("rsa-data", one("ours"), ours=True),
    )
    note = (
        f"Batches of {BATCH}: a feature of 1024 numbers and 512 pixels twice an image, float16 on "
        "disk (Parquet lists for datasets, .npy in tars for webdataset), float32 tensors; two "
        "epochs; the loader runs in the process itself."
    )

    def said(found: Any) -> dict[str, str]:
        first = next(iter(found.values()))
        return {
            name: f"{int(one[0]):,} images, sums differ by {np.abs(one / first - 1).max():.0e}"
            for name, one in found.items()
        }

    return Row("Reading features into torch", 2 * count, "images", ways, said, note)


def tables(given: Given) -> tuple[WorkDir, int]:
    """A work dir with features, pixels and captions, and how many images it has."""
    count = 600 if given.small else 24_000
    work = WorkDir(str(given.folder / "training"))
    if not (given.folder / "training").is_dir():
        made, texts = examples(count), [str(i) for i in range(count)]
        write(
            work,
            "nyuv2",
            scenes=[f"scene {i % 100}" for i in range(count)],
            texts=[[text] for text in texts],
            features=dict(zip(texts, made["features"], strict=True)),
            relative=made["y"],
            metric=made["depth"],
            part=2000,
        )
    return work, count


def files(work: WorkDir) -> dict[str, list[str]]:
    """Paths of the data files by table."""
    names = ("samples", "embeddings/occupancy/minilm", "depth/files")
    opened = {name: work.table("nyuv2", name) for name in names}
    return {
        name: [f"{work.store.location}/{t.path}/{t.receipt(n).file}" for n in t.parts()]
        for name, t in opened.items()
    }
