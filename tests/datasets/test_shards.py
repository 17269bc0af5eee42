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
TABLES = ("segments/labels", "embeddings/images/thumbnail", "depth/files-relative")


def tables(work: WorkDir, choice: str, options: dict, root: Path, place: Path, workers: int = 1):
    """Segments, thumbnails and depth of a root, and how many samples each part has."""
    name = chains.samples(work, choice, options, root=root)
    for stage, given in (
        ("detect", {"segments": f"labels:{place / 'labels'}", "names": "nyu13"}),
        ("embed-images", {"encoder": "thumbnail"}),
        ("depth", {"depth_model": f"files:{place / 'relative'}", "pixels": 16}),
    ):
        job = jobs.job(work, stages.bind(stage, given), name, root=root)
        assert not runs.run(job, bar=rooms.NoBar, engine=EngineOptions(workers=workers)).undone
    samples = work.table(name, "samples")
    found = {}
    for table in TABLES:
        there = work.table(name, table)
        found[table] = pa.concat_tables([there.read(n) for n in there.parts()])
    return found, [receipt.rows for receipt in samples.receipts(samples.parts())]


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """What a folder gives, and the folder with label maps and relative depth."""
    place = tmp_path_factory.mktemp("loose")
    for key, parts in frames().items():
        labels = io.BytesIO()
        Image.fromarray(np.full((40, 60), int(key[-1]), np.uint8)).save(labels, "PNG")
        relative = io.BytesIO()
        np.save(relative, np.linspace(0.1, 1, 2400).reshape(40, 60))
        for path, data in {
            f"photos/{key}.png": parts["png"],
            f"photos/depth/{key}.png": parts.get("depth.png"),
            f"labels/{key}.png": labels.getvalue(),
            f"relative/{key}.npy": relative.getvalue(),
        }.items():
            if data is not None:
                (place / path).parent.mkdir(parents=True, exist_ok=True)
                (place / path).write_bytes(data)
    work = WorkDir(place / "work")
    return tables(work, "folder:photos", COLUMNS, place / "photos", place)[0], place


@pytest.mark.parametrize("form", FORMS)
def test_shards_give_what_loose_files_give(tmp_path, expected, form):
    write, choice, options = FORMS[form]
    write(frames(), tmp_path / "photos")
    found, parts = tables(
        WorkDir(tmp_path / "work"), choice, options, tmp_path / "photos", expected[1]
    )
    assert parts == [4, 4, 2]
    for table in TABLES:
        assert found[table].equals(expected[0][table]), table


def test_two_workers_and_smaller_parts_change_nothing(tmp_path, expected):
    as_tars(frames(), tmp_path / "photos")
    options = TAR | {"part_size": 3}
    root, work = tmp_path / "photos", WorkDir(tmp_path / "work")
    found, parts = tables(work, "webdataset:photos", options, root, expected[1], workers=2)
    assert parts == [3, 1, 3, 1, 2]
    for table in TABLES:
        assert found[table].equals(expected[0][table]), table


def tar_of(path: Path, members: dict[str, bytes | tarfile.TarInfo]) -> None:
    with tarfile.open(path, "w", format=tarfile.GNU_FORMAT) as tar:
        for name, content in members.items():
            info = content if isinstance(content, tarfile.TarInfo) else tarfile.TarInfo(name)
            data = b"" if isinstance(content, tarfile.TarInfo) else content
            info.size = info.size or len(data)
            tar.addfile(info, io.BytesIO(data))


def link(name: str, kind: bytes) -> tarfile.TarInfo:
    info = tarfile.TarInfo(name)
    info.type, info.linkname = kind, "a.png"
    return info


def cut(data: bytes) -> bytes:
    return data[:1600]


def without_end(data: bytes) -> bytes:
    return data[: 4 * 512]


def wrong_checksum(data: bytes) -> bytes:
    return data[:1024] + b"x" + data[1025:]


def endless(data: bytes) -> bytes:
    """The second header says 8 GB."""
    header = tarfile.TarInfo.frombuf(data[1024:1536], "utf-8", "strict")
    header.size = 8 << 30
    return data[:1024] + header.tobuf(tarfile.GNU_FORMAT) + data[1536:]


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (cut, "unexpected end of data|bytes of 'b.png'"),
        (without_end, "end of the archive at byte 2,048, found the end of the file"),
        (wrong_checksum, "end of the archive at byte 1,024, found a damaged header"),
        (endless, "unexpected end of data|bytes of 'b.png'"),
        (lambda data: data[:100], "expected a tar, found"),
        (lambda data: b"", "expected a tar, found"),
        (lambda data: b"PK" + bytes(2000), "expected a tar, found"),
    ],
)
def test_a_broken_tar_is_refused_by_name(tmp_path, damage, words):
    tar_of(tmp_path / "a.tar", {"a.png": b"a" * 300, "b.png": b"b" * 300})
    data = damage((tmp_path / "a.tar").read_bytes())
    (tmp_path / "a.tar").write_bytes(data)
    with pytest.raises(RsaDataError, match=rf"a\.tar: .*({words})"):
        webdataset().index(tmp_path, None)


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ({"b.png": link("b.png", tarfile.LNKTYPE)}, "found a hard link: 'b.png'"),
        ({"b.png": link("b.png", tarfile.SYMTYPE)}, "found a symbolic link: 'b.png'"),
        ({"/etc/b.png": b"b"}, "expected a path below"),
        ({"../b.png": b"b"}, "expected a path below"),
        ({"a.PNG": b"b"}, "expected one member a.png, found two"),
        ({"a.jpg": b"b"}, "expected one image, found png, jpg"),
    ],
)
def test_members_that_are_no_samples_are_refused(tmp_path, members, words):
    tar_of(tmp_path / "a.tar", {"a.png": b"a", **members})
    with pytest.raises(RsaDataError, match=words):
        webdataset().index(tmp_path, None)


def test_members_in_any_order_and_with_long_names(tmp_path):
    long = "folder/" * 20 + "frame"
    members = {"b.json": b"{}", "a.png": b"1", f"{long}.png": b"22", "b.png": b"333", "a.txt": b"a"}
    tar_of(tmp_path / "a.tar", members)
    rows = webdataset().index(tmp_path, None).to_pylist()
    assert [row["sample_id"] for row in rows] == [f"webdataset/train/{k}" for k in ("b", "a", long)]
    contents = [images.read_bytes(tmp_path / row["image"]) for row in rows]
    assert contents == [b"333", b"1", b"22"]


def test_a_shard_that_was_replaced_since_is_a_failed_row(tmp_path):
    tar_of(tmp_path / "a.tar", {"a.png": b"a" * 300, "b.png": b"b" * 300})
    image = webdataset().index(tmp_path, None)["image"][1].as_py()
    tar_of(tmp_path / "a.tar", {"0.png": b"0", "a.png": b"a" * 900, "b.png": b"b" * 300})
    with pytest.raises(RowError, match=r"expected b.png at byte \d+ of a.tar, found another"):
        images.read_bytes(tmp_path / image)
    (tmp_path / "a.tar").unlink()
    with pytest.raises(RowError, match="no such"):
        images.read_bytes(tmp_path / image)


def test_splits_scenes_and_cameras_come_from_names_or_json(tmp_path):
    about = {"room": "kitchen", "part": "val", "k": [[500, 0, 320], [0, 510, 240], [0, 0, 1]]}
    for shard in ("train-0.tar", "test-00001-of-2.tar", "val/0.tar", "validation_3.tar", "x.tar"):
        (tmp_path / shard).parent.mkdir(exist_ok=True)
        key = shard.partition(".")[0]
        tar_of(tmp_path / shard, {f"{key}.png": b"", f"{key}.json": json.dumps(about).encode()})
    rows = webdataset().index(tmp_path, None).to_pylist()
    splits = {row["sample_id"].partition("/")[2].partition("/")[2]: row["split"] for row in rows}
    assert splits == {
        "test-00001-of-2": "test", "train-0": "train", "val/0": "val", "validation_3": "val",
        "x": "train",
    }  # fmt: skip
    options = {"scene": "room", "split": "part", "intrinsics": "k"}
    (row, *_) = webdataset(**options).index(tmp_path, None).to_pylist()
    assert (row["split"], row["scene"]) == ("val", "kitchen")
    assert [row[k] for k in ("fx", "fy", "cx", "cy")] == [500, 510, 320, 240]
    with pytest.raises(RsaDataError, match=r"json: colour: expected a name"):
        webdataset(scene="colour").index(tmp_path, None)


def test_keys_that_repeat_from_shard_to_shard(tmp_path):
    for number in range(2):
        tar_of(tmp_path / f"{number}.tar", {"a.png": b"a"})
    with pytest.raises(RsaDataError, match="same key train/a"):
        webdataset().index(tmp_path, None)
    rows = webdataset(keys="shard/member").index(tmp_path, None)
    assert rows["sample_id"].to_pylist() == ["webdataset/train/0/a", "webdataset/train/1/a"]


def test_broken_zips_and_parquet_files_are_refused(tmp_path):
    as_zips(frames(), tmp_path / "zips")
    path = tmp_path / "zips" / "00001.zip"
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(RsaDataError, match=r"00001\.zip: expected a zip, found"):
        zipped().index(tmp_path / "zips", None)
    as_parquet(frames(), tmp_path / "parquet")
    with pytest.raises(RsaDataError, match="expected the column photo, found image, depth"):
        parquet(image="photo").index(tmp_path / "parquet", None)
    path = tmp_path / "parquet" / "train-00001.parquet"
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(RsaDataError, match=r"00001\.parquet: expected a Parquet file"):
        parquet().index(tmp_path / "parquet", None)


def test_parquet_with_paths_plain_bytes_and_cameras(tmp_path):
    photo = frames()["scene0/0000"]["png"]
    (tmp_path / "a.png").write_bytes(photo)
    table = {"image": ["a.png"], "raw": [photo], "k": [[1.0, 2.0, 3.0, 4.0]], "part": ["val"]}
    pq.write_table(pa.table(table), tmp_path / "x.parquet")
    (row,) = parquet(intrinsics="k", split="part").index(tmp_path, None).to_pylist()
    assert (row["sample_id"], row["image"], row["fx"]) == ("parquet/val/a", "a.png", 1.0)
    (row,) = parquet(image="raw").index(tmp_path, None).to_pylist()
    assert row["sample_id"] == "parquet/train/x/0000-000000"
    assert images.read_image(tmp_path / row["image"]).shape == (40, 60, 3)
    with pytest.raises(RsaDataError, match="column k: expected images"):
        parquet(image="k").index(tmp_path, None)


def test_other_options_are_refused():
    with pytest.raises(UsageError, match="depth and depth_unit go together"):
        open_dataset("webdataset:x", {"depth": "depth.png"})
    with pytest.raises(UsageError, match="parquet: depth_unit: expected m, cm, mm or m/N"):
        open_dataset("parquet:x", {"depth": "d", "depth_unit": "ft"})
    with pytest.raises(UsageError, match="keys: expected member or shard/member"):
        open_dataset("zip:x", {"keys": "other"})
