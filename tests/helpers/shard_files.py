"""The same photographs as loose files and in every kind of shard, and what stages make of them."""

import io
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

from rsa_data.runner import chains, jobs, runs, stages
from rsa_data.runner.engines.pool import EngineOptions
from rsa_data.store.tables import WorkDir


def frames(count: int = 10) -> dict[str, dict[str, bytes]]:
    """Photographs with depth in mm, by key and ending; one broken, one without depth."""
    rng = np.random.default_rng(0)
    made: dict[str, dict[str, bytes]] = {}
    for number in range(count):
        photo, depth = io.BytesIO(), io.BytesIO()
        Image.fromarray(rng.integers(0, 255, (40, 60, 3), np.uint8)).save(photo, "PNG")
        Image.fromarray(rng.integers(500, 5000, (40, 60), np.uint16)).save(depth, "PNG")
        content = photo.getvalue() if number != 3 else b"\x89PNG\r\n\x1a\nbroken"
        parts = {"png": content, "depth.png": depth.getvalue(), "txt": f"frame {number}".encode()}
        made[f"scene{number // 4}/{number:04d}"] = parts
    del made["scene1/0006"]["depth.png"]
    made["scene2/0008"]["txt"] = "a\nb ö\n".encode()
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
        texts = [parts["txt"].decode().split("\n")[:2] for parts in shard.values()]
        table = table.append_column("txt", pa.array(texts, pa.list_(pa.string())))
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
            "image": [{"bytes": p["png"], "path": f"{k}.png"} for k, p in shard.items()],
            "depth": [
                {"bytes": p["depth.png"], "path": f"{k}.png"} if "depth.png" in p else None
                for k, p in shard.items()
            ],
            "key": list(shard),
        }
        made_set = package.Dataset.from_dict(rows, features=features)
        made_set.to_parquet(str(root / f"train-{number:05d}.parquet"))


TAR = {"depth": "depth.png", "depth_unit": "mm"}
COLUMNS = {"depth": "depth", "depth_unit": "mm"}
FORMS: dict[str, tuple[Callable[..., None], str, dict[str, str]]] = {
    "tar": (as_tars, "webdataset:photos", TAR),
    "webdataset": (as_webdataset, "webdataset:photos", TAR),
    "zip": (as_zips, "zip:photos", TAR),
    "parquet": (as_parquet, "parquet:photos", COLUMNS),
    "datasets": (as_datasets, "parquet:photos", COLUMNS | {"id": "key"}),
}
TABLES = (
    "samples",
    "segments/labels",
    "captions/occupancy",
    "embeddings/images/thumbnail",
    "depth/files-relative",
)
HERE = EngineOptions()


def tables(
    work: WorkDir,
    choice: str,
    options: dict,
    root: Path,
    place: Path,
    engine: EngineOptions = HERE,
):
    """Tables of a root, and how many samples each part has: index, segments, captions and so on.

    Of samples, all but where images and depth lie. engine : for segments and depth.
    """
    name = chains.samples(work, choice, options, root=root)
    for stage, given, upstream in (
        ("detect", {"segments": f"labels:{place / 'labels'}", "names": "nyu13"}, None),
        ("captions", {"variants": 3}, "segments/labels"),
        ("embed-images", {"encoder": "thumbnail"}, None),
        ("depth", {"depth_model": f"files:{place / 'relative'}", "pixels": 16}, None),
    ):
        job = jobs.job(work, stages.bind(stage, given), name, root=root, upstream=upstream)
        workers = engine if stage in ("detect", "depth") else HERE
        assert not runs.run(job, bar=rooms.NoBar, engine=workers).undone
    samples = work.table(name, "samples")
    found = {}
    for table in TABLES:
        there = work.table(name, table)
        found[table] = pa.concat_tables([there.read(n) for n in there.parts()])
    found["samples"] = found["samples"].drop_columns(["image", "depth"])
    return found, [receipt.rows for receipt in samples.receipts(samples.parts())]
