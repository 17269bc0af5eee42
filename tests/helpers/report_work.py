"""A small work dir with everything a report shows, and texts that try to break out of a page."""

import io
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import torch
from made_tables import ENCODER, write

from rsa_data.heads.checkpoint import ScaleHead, build_network
from rsa_data.store import schemas
from rsa_data.store.tables import Description, Made, WorkDir, to_json

EVIL = "<script>alert('x')</script>\"'&"
SIZE = (24, 32)
DIM = 8


def made(folder: Path) -> WorkDir:
    """Datasets rooms and roads, four train and four test images each, with a head on both."""
    work = WorkDir(folder / "work")
    random = np.random.default_rng(0)
    for dataset, far in (("rooms", 4.0), ("roads", 40.0)):
        texts = [[f"An image with {EVIL} and bed {k}", f"An image with bed {k}"] for k in range(4)]
        features = {t: random.normal(size=DIM).astype(np.float32) for group in texts for t in group}
        y = random.uniform(1, 9, (4, SIZE[0] * SIZE[1])).astype(np.float32)
        metric = (far / y).astype(np.float32)
        about = {"texts": texts, "features": features, "builder": "folder", "encoder": ENCODER}
        scenes = [f"{EVIL} kitchen_{k // 2}" for k in range(4)]
        write(work, dataset, scenes=scenes, relative=y[:, :64], metric=metric[:, :64], **about)
        write(
            work, dataset, scenes=scenes, relative=y, metric=metric, size=SIZE, split="test",
            first_part=1, failed=(1,), **about,
        )  # fmt: skip
        _segments(work, dataset)
        _image_features(work, dataset, random)
        _files(folder / "files" / dataset, work, dataset)
    _head(work)
    return work


def _segments(work: WorkDir, dataset: str) -> None:
    table = work.table(dataset, "segments/labels")
    table.bind(
        Description(stage="detect", schema="segments", inputs=["samples"], options={"source": EVIL})
    )
    for number in (0, 1):
        ids = work.table(dataset, "samples").read(number)["sample_id"].to_pylist()
        values = {
            "sample_id": ids,
            "status": ["ok"] * 3 + ["failed"],
            "error": [None] * 3 + [f"{ids[3]}.png: {EVIL}"],
            "width": [SIZE[1]] * 4,
            "height": [SIZE[0]] * 4,
            "label": [["bed", EVIL], ["chair"], [], []],
            "score": [[1.0, 0.5], [1.0], [], []],
            "area": [[0.5, 0.1], [0.2], [], []],
            "box": [[[0, 0, 16, 24], [4, 4, 9, 9]], [[1, 1, 20, 20]], [], None],
            "is_thing": [[True, True], [True], [], []],
        }
        names = schemas.schema("segments").names
        content = schemas.from_columns("segments", {n: values.get(n, [None] * 4) for n in names})
        counts = {"ok": 3, "failed": 1, "skipped": 0, "split": ("train", "test")[number]}
        table.commit(number, content, Made(**counts, fingerprint="made"))


def _image_features(work: WorkDir, dataset: str, random: np.random.Generator) -> None:
    table = work.table(dataset, "embeddings/images/thumbs")
    table.bind(Description(stage="embed-images", schema="image_embeddings", inputs=["samples"]))
    ids = work.table(dataset, "samples").read(0)["sample_id"].to_pylist()
    values = {
        "sample_id": ids,
        "status": ["ok"] * 4,
        "error": [None] * 4,
        "embedding": schemas.embedding_column(random.normal(size=(4, 5)).astype(np.float32)),
    }
    content = schemas.from_columns("image_embeddings", values)
    counts = {"ok": 4, "failed": 0, "skipped": 0, "split": "train"}
    table.commit(0, content, Made(**counts, fingerprint="made"))


def _files(root: Path, work: WorkDir, dataset: str) -> None:
    """A root for the dataset, though its samples name no image: there are no pictures."""
    root.mkdir(parents=True)
    work.store.write(f"{dataset}/root.txt", str(root).encode())


def _head(work: WorkDir) -> None:
    torch.manual_seed(0)
    description = {
        "format": 1,
        "architecture": {"name": "linear"},
        "features": {"dim": DIM, "style": "occupancy", "encoder": "minilm"},
        "depth_model": {"model": "files"},
        "datasets": {"rooms": {"images": 4, "validation_images": 1, "validation": EVIL}},
        "options": {"loss": "l1", "supervision": "depth", "units": "metres"},
        "parameters": 18,
    }
    network = build_network({"name": "linear"}, DIM)
    head = ScaleHead(network, description, torch.zeros(DIM), torch.ones(DIM))
    head.save(work.store, "heads/small")
    rows = [
        {"epoch": e, "lr": 0.1, "train_loss": 1 / e, "dataset": d, "val_abs_rel": 0.5 / e}
        | {"best": e == 3}
        for e in (1, 2, 3)
        for d in ("rooms", "roads")
    ]
    names = schemas.schema("history").names
    file = io.BytesIO()
    pq.write_table(
        schemas.from_columns("history", {n: [row[n] for row in rows] for n in names}), file
    )
    work.store.write("heads/small/history.parquet", file.getvalue())
    work.store.write("heads/small/_table.json", to_json({}))
    csv = "dataset,method,images,failed,scenes,delta1,abs_rel,rmse,log10,silog,abs_rel_low,"
    csv += (
        f'abs_rel_high\nrooms,"{EVIL.replace(chr(34), chr(34) * 2)}",4,0,2,.9,.1,.3,.1,9,.08,.2\n'
    )
    csv += (
        "roads,head small,4,0,2,.5,.4,.9,.2,19,.3,.5\nroads,constant,4,0,2,.5,.3,.9,.2,19,.2,.4\n"
    )
    for folder in ("heads/small/evaluation", "heads/small/robustness", "comparisons"):
        work.store.write(f"{folder}/rsa/summary.csv", csv.encode())
