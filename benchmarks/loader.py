"""Training samples a second from a work dir, against WebDataset and Hugging Face `datasets`.

    python benchmarks/loader.py [--images 8000] [--pixels 1024] [--rounds 3]

A work dir of made tables (features of 512 numbers, two captions an image, relative and metric
depth at --pixels pixels) is exported as WebDataset shards and as Parquet by `rsa-data export`.
Then one process passes over all images in turns: the stream of ShardDataset, webdataset's pipeline
with its shuffle buffer, and a shuffled `datasets` table. All give batches of 64 with one caption
drawn for each image, as float32 tensors. Each pass opens its files again, from the page cache.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

import numpy as np
import recording
import torch
from made_tables import write

import rsa_data
from rsa_data.store.tables import WorkDir
from rsa_data.views.export import export

BATCH, PART, DIM = 64, 1000, 512
Batches = Iterator[dict[str, torch.Tensor]]


def made(folder: Path, images: int, pixels: int) -> None:
    """The work dir and both exports."""
    rng = np.random.default_rng(0)
    work = WorkDir(folder / "work")
    texts = [[f"a {i}", f"b {i}"] for i in range(images)]
    features = {t: rng.normal(size=DIM).astype(np.float16) for pair in texts for t in pair}
    relative = rng.uniform(0.5, 9, (images, pixels))
    scenes = [f"scene {i // 10}" for i in range(images)]
    write(work, "rooms", scenes=scenes, texts=texts, features=features, relative=relative,
          metric=1 / (0.1 * relative + 0.1), part=PART, builder="folder")  # fmt: skip
    for kind in ("webdataset", "parquet"):
        export(work, out=folder / kind, format=kind, depth="files")


def by_rsa_data(folder: Path, epoch: int) -> Batches:
    stream = rsa_data.ShardDataset(folder / "work", "rooms").stream(batch_size=BATCH, seed=0)
    stream.set_epoch(epoch)
    yield from torch.utils.data.DataLoader(stream, batch_size=None)


def by_webdataset(folder: Path, epoch: int) -> Batches:
    import webdataset

    rng = np.random.default_rng(epoch)

    def chosen(sample: dict[str, Any]) -> tuple[np.ndarray, ...]:
        features = sample["embedding.npy"]
        names = ("relative.npy", "metric.npy")
        pixels = (sample[name].astype(np.float32) for name in names)
        return (features[rng.integers(len(features))].astype(np.float32), *pixels)

    shards = sorted(map(str, (folder / "webdataset" / "rooms").glob("*.tar")))
    data = webdataset.WebDataset(shards, shardshuffle=len(shards), seed=epoch)
    for batch in data.shuffle(1000).decode().map(chosen).batched(BATCH):
        feature, relative, metric = map(torch.as_tensor, batch)
        yield {"feature": feature, "relative": relative, "metric": metric}


def by_datasets(folder: Path, epoch: int) -> Batches:
    import datasets

    files = sorted(map(str, (folder / "parquet" / "rooms").glob("*.parquet")))
    cache = str(folder / "cache")
    data = datasets.load_dataset("parquet", data_files=files, split="train", cache_dir=cache)
    rng = np.random.default_rng(epoch)
    images = rng.permutation(len(data) // 2)  # two captions an image, one after the other
    data = data.select_columns(["embedding", "relative", "metric"]).with_format("torch")
    rows = data.select(2 * images + rng.integers(2, size=len(images)))
    for batch in rows.iter(BATCH):
        named = {"feature": "embedding", "relative": "relative", "metric": "metric"}
        yield {name: batch[column].float() for name, column in named.items()}


WAYS: dict[str, Callable[[Path, int], Batches]] = {
    "rsa_data.ShardDataset": by_rsa_data,
    "webdataset": by_webdataset,
    "datasets": by_datasets,
}


def passed(batches: Batches, images: int) -> float:
    """Samples a second of a pass; raises ValueError unless it gave every image once."""
    begun, count, total = time.monotonic(), 0, 0.0
    for batch in batches:
        count += len(batch["feature"])
        total += float(batch["relative"][:, 0].sum())
    seconds = time.monotonic() - begun
    if count != images:
        raise ValueError(f"expected {images} images, found {count}")
    SUMS.append(round(total / images, 4))
    return images / seconds


SUMS: list[float] = []


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=8000)
    parser.add_argument("--pixels", type=int, default=1024)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    torch.set_num_threads(1)
    rates: dict[str, list[float]] = {name: [] for name in WAYS}
    with tempfile.TemporaryDirectory(prefix="rsa-data-loader-") as name:
        folder = Path(name)
        made(folder, given.images, given.pixels)
        passed(by_datasets(folder, 0), given.images)  # fills its cache, which the others need not
        for turn in range(given.rounds):
            for way, read in WAYS.items():
                rates[way].append(passed(read(folder, turn), given.images))
                print(way, f"{rates[way][-1]:,.0f} samples a second", flush=True)
    if len(set(SUMS)) != 1:
        raise ValueError(f"expected the same pixels from all, found means {sorted(set(SUMS))}")
    medians = {way: float(np.median(each)) for way, each in rates.items()}
    base = medians["rsa_data.ShardDataset"]
    recording.table(
        "loader",
        "Samples a second of one process",
        ["reader", *(f"turn {k + 1}" for k in range(given.rounds)), "median", "ShardDataset to it"],
        [
            [
                way,
                *(round(rate) for rate in each),
                round(medians[way]),
                round(base / medians[way], 2),
            ]
            for way, each in rates.items()
        ],
        note=f"{given.images:,} images, features of {DIM} numbers, {given.pixels:,} pixels of "
        f"relative and metric depth, batches of {BATCH}, in turns; `datasets` reads its cache.",
        packages=("webdataset", "datasets"),
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
