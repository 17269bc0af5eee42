"""Two epochs of shuffled batches as tensors: datasets, webdataset, and this project's stream."""

import io
import json
import sys
import tarfile
import time
from pathlib import Path

import numpy as np
import torch

given = json.loads(sys.argv[1])
torch.set_num_threads(given["threads"])
folder, NAMES = Path(given["folder"]), ("feature", "relative", "metric")


def prepare():
    """The same arrays as Parquet with lists, and as tars of .npy."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    folder.mkdir(exist_ok=True)
    _, features, depth = given["files"].values()
    for number, (one, other) in enumerate(zip(features, depth, strict=True)):
        both = pq.read_table(one, columns=["embedding"]), pq.read_table(other)
        columns = both[0]["embedding"], both[1]["relative"], both[1]["metric"]
        arrays = [
            np.stack([np.frombuffer(value, "<f2") for value in column.to_pylist()])
            for column in columns
        ]
        lists = [pa.FixedSizeListArray.from_arrays(a.ravel(), a.shape[1]) for a in arrays]
        pq.write_table(pa.table(lists, NAMES), folder / f"{number:05d}.parquet")
        with tarfile.open(folder / f"{number:05d}.tar", "w") as tar:
            for row in range(len(arrays[0])):
                for name, array in zip(NAMES, arrays, strict=True):
                    file = io.BytesIO()
                    np.save(file, array[row])
                    info = tarfile.TarInfo(f"{number:03d}{row:06d}.{name}.npy")
                    info.size = file.tell()
                    file.seek(0)
                    tar.addfile(info, file)


def table():
    import datasets

    datasets.disable_progress_bars()
    files = sorted(map(str, folder.glob("*.parquet")))
    return datasets.Dataset.from_parquet(files, cache_dir=str(folder / "cache"))


def index():
    from torch.utils.data import DataLoader

    loader = DataLoader(table().with_format("torch"), given["batch"], shuffle=True)
    for _ in range(2):
        yield from loader


def webdataset():
    import webdataset as wds

    tars = sorted(map(str, folder.glob("*.tar")))
    data = (
        wds.WebDataset(tars, shardshuffle=len(tars), seed=0, empty_check=False)
        .shuffle(4096)
        .decode()
        .to_tuple(*(f"{name}.npy" for name in NAMES))
        .batched(given["batch"])
    )
    for _ in range(2):
        for batch in data:
            yield dict(zip(NAMES, batch, strict=True))


def ours():
    from torch.utils.data import DataLoader

    from rsa_data import ShardDataset

    data = ShardDataset(given["work"], "nyuv2")
    stream = data.stream(batch_size=given["batch"])
    for epoch in range(2):
        stream.set_epoch(epoch)
        yield from DataLoader(stream, batch_size=None)


if given["way"] == "prepare":
    prepare()
    steady = 0.0
else:
    begun = time.process_time()
    sums = np.zeros(4)
    for batch in globals()[given["way"]]():
        tensors = [torch.as_tensor(batch[name], dtype=torch.float32) for name in NAMES]
        sums += [len(tensors[0]), *(float(t.sum(dtype=torch.float64)) for t in tensors)]
    steady = time.process_time() - begun
    Path(given["out"]).write_text(json.dumps(sums.tolist()))
print(json.dumps({"steady": steady}))
