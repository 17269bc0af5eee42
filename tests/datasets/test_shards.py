"""Images in shards give what the same images give as loose files; broken shards are refused."""

import io
import json
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import rooms
from PIL import Image

from rsa_data.common.errors import RowError, RsaDataError, UsageError
from rsa_data.datasets import images
from rsa_data.datasets.index import open_dataset
from rsa_data.datasets.parquet import parquet
from rsa_data.datasets.webdataset import webdataset, zipped
from rsa_data.runner import chains, jobs, runs, stages
from rsa_data.runner.engines.pool import EngineOptions
from rsa_data.store.tables import WorkDir

LABELS = 13


def frames(count: int = 10) -> dict[str, dict[str, bytes]]:
    """Photographs with depth in mm, by key and ending; one broken, one without depth."""
    rng = np.random.default_rng(0)
    made: dict[str, dict[str, bytes]] = {}
    for number in range(count):
        photo, depth = io.BytesIO(), io.BytesIO()
        Image.fromarray(rng.integers(0, 255, (40, 60, 3), np.uint8)).save(photo, "PNG")
        Image.fromarray(rng.integers(500, 5000, (40, 60), np.uint16)).save(depth, "PNG")
        content = photo.getvalue() if number != 3 else b"\x89PNG\r\n\x1a\nbroken"
        made[f"scene{number // 4}/{number:04d}"] = {"png": content, "depth.png": depth.getvalue()}
    del made["scene1/0006"]["depth.png"]
    return made


def shards(made: dict[str, dict[str, bytes]]) -> list[dict[str, dict[str, bytes]]]:
    """Four samples each."""
    keys = list(made)
    return [{key: made[key] for key in keys[i : i + 4]} for i in range(0, len(keys), 4)]


def as_tars(made: dict[str, dict[str, bytes]], root: Path) -> None:
    root.mkdir()
    for number, shard in enumerate(shards(made)):
        with tarfile.open(root / f"{number:05d}.tar", "w") as tar:
            for key, parts in shard.items():
                for ending, data in parts.items():
                    info = tarfile.TarInfo(f"{key}.{ending}")
                    info.size = len(data)
                    tar.addfile(info, io.BytesIO(data))


def as_webdataset(made: dict[str, dict[str, bytes]], root: Path) -> None:
    """Tars by WebDataset's own writer."""
    package = pytest.importorskip("webdataset")
    root.mkdir()
    for number, shard in enumerate(shards(made)):
        with package.TarWriter(str(root / f"{number:05d}.tar")) as writer:
            for key, parts in shard.items():
                writer.write({"__key__": key, **parts})


def as_zips(made: dict[str, dict[str, bytes]], root: Path) -> None:
    root.mkdir()
    for number, shard in enumerate(shards(made)):
        kind = zipfile.ZIP_DEFLATED if number else zipfile.ZIP_STORED
        with zipfile.ZipFile(root / f"{number:05d}.zip", "w", kind) as archive:
            for key, parts in shard.items():
                for ending, data in parts.items():
                    archive.writestr(f"{key}.{ending}", data)


def as_parquet(made: dict[str, dict[str, bytes]], root: Path) -> None:
    root.mkdir()
    for number, shard in enumerate(shards(made)):
        picture = {"image": "png", "depth": "depth.png"}
        columns = {
            name: [
                {"bytes": parts[ending], "path": f"{key}.png"} if ending in parts else None
                for key, parts in shard.items()
            ]
            for name, ending in picture.items()
        }
        kind = pa.struct({"bytes": pa.binary(), "path": pa.string()})
        table = pa.table({name: pa.array(rows, kind) for name, rows in columns.items()})
        pq.write_table(table, root / f"train-{number:05d}.parquet", row_group_size=3)


def as_datasets(made: dict[str, dict[str, bytes]], root: Path) -> None:
    """Parquet by the library `datasets`, as data sets on the hub are."""
    package = pytest.importorskip("datasets")
    features = package.Features(
        {"image": package.Image(), "depth": package.Image(), "key": package.Value("string")}
    )
    root.mkdir()
    for number, shard in enumerate(shards(made)):
        rows = {
            "image": [{"bytes": p["png"], "path": None} for p in shard.values()],
            "depth": [
                {"bytes": p["depth.png"], "path": None} if "depth.png" in p else None
                for p in shard.values()
            ],
            "key": list(shard),
        }
        made_set = package.Dataset.from_dict(rows, features=features)
        made_set.to_parquet(str(root / f"train-{number:05d}.parquet"))


DEPTH = {"depth": "depth.png", "depth_unit": "mm"}
FORMS: dict[str, tuple[Callable[..., None], str, dict[str, object]]] = {
    "tar": (as_tars, "webdataset:photos", DEPTH),
    "webdataset": (as_webdataset, "webdataset:photos", DEPTH),
    "zip": (as_zips, "zip:photos", DEPTH),
    "parquet": (as_parquet, "parquet:photos", {"depth": "depth", "depth_unit": "mm"}),
    "datasets": (as_datasets, "parquet:photos", {"depth": "depth", "depth_unit": "mm", "id": "key"}),
}


def tables(work: WorkDir, choice: str, options: dict, root: Path, place: Path, workers: int = 1):
    """Segments, thumbnails, and depth of a root, and how many samples each part has."""
    name = chains.samples(work, choice, options, root=root)
    for stage, given in (
        ("detect", {"source": f"labels:{place / 'labels'}", "names": "nyu13"}),
        ("embed-images", {"encoder": "thumbnail"}),
        ("depth", {"depth_model": f"files:{place / 'relative'}", "pixels": 16}),
    ):
        job = jobs.job(work, stages.bind(stage, given), name, root=root)
        assert not runs.run(job, bar=rooms.NoBar, engine=EngineOptions(workers=workers)).undone
    samples = work.table(name, "samples")
    found = {}
    for table in ("segments/labels", "embeddings/images/thumbnail", "depth/files-relative"):
        there = work.table(name, table)
        rows = pa.concat_tables([there.read(n) for n in there.parts()])
        found[table] = rows.to_pydict()
    return found, [receipt.rows for receipt in samples.receipts(samples.parts())]


def loose(made: dict[str, dict[str, bytes]], root: Path) -> None:
    for key, parts in made.items():
        for ending, data in parts.items():
            folder = "depth" if ending == "depth.png" else "rgb"
            path = root / folder / f"{key}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """What a folder gives, and the folder with labels and relative depth."""
    place = tmp_path_factory.mktemp("loose")
    made = frames()
    loose(made, place / "photos")
    for key in made:
        for folder, data in (("labels", np.full((40, 60), 5, np.uint8)), ("relative", None)):
            path = place / folder / "rgb" / f"{key}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            if data is None:
                values = np.linspace(0.1, 1, 2400).reshape(40, 60)
                np.save(path.with_suffix(".npy"), values)
            else:
                Image.fromarray(data).save(path)
    options = {"images": "rgb", "depth": "depth", "depth_unit": "mm"}
    return tables(WorkDir(place / "work"), "folder:photos", options, place / "photos", place)[0], place
