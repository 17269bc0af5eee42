"""Images in shards give what the same images give as loose files; broken shards are refused."""

import io
import json
import tarfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from PIL import Image
from shard_files import (
    FORMS,
    TABLES,
    TAR,
    as_parquet,
    as_tars,
    as_zips,
    frames,
    tables,
)

from rsa_data.cli.main import cli
from rsa_data.common.errors import RowError, RsaDataError, UsageError
from rsa_data.datasets import images
from rsa_data.datasets.depth_files import any_file
from rsa_data.datasets.index import open_dataset
from rsa_data.datasets.parquet import parquet
from rsa_data.datasets.shard_listing import split_of
from rsa_data.datasets.webdataset import Members, webdataset, zipped
from rsa_data.runner import chains
from rsa_data.runner.engines.pool import EngineOptions
from rsa_data.store.tables import WorkDir


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


def test_smaller_parts_change_nothing(tmp_path, expected):
    as_tars(frames(), tmp_path / "photos")
    options = TAR | {"part_size": 3}
    root, work = tmp_path / "photos", WorkDir(tmp_path / "work")
    found, parts = tables(work, "webdataset:photos", options, root, expected[1])
    assert parts == [3, 1, 3, 1, 2]
    for table in TABLES:
        assert found[table].equals(expected[0][table]), table


@pytest.mark.ray
@pytest.mark.filterwarnings("ignore")
def test_ray_workers_change_nothing(tmp_path, expected):
    ray = pytest.importorskip("ray")
    ray.init(address="local", num_cpus=4, include_dashboard=False)
    try:
        as_tars(frames(), tmp_path / "photos")
        root, work = tmp_path / "photos", WorkDir(tmp_path / "work")
        engine = EngineOptions("ray", workers=2)
        found, _ = tables(work, "webdataset:photos", TAR, root, expected[1], engine)
    finally:
        ray.shutdown()
    for table in TABLES:
        assert found[table].equals(expected[0][table]), table


def test_shards_that_are_as_they_were_are_not_read_again(tmp_path):
    made, root, work = frames(12), tmp_path / "photos", WorkDir(tmp_path / "work")
    as_tars(made, root)
    chains.samples(work, "webdataset:photos", {}, root=root)
    (root / "00001.tar").rename(tmp_path / "00001.tar")
    chains.samples(work, "webdataset:photos", {}, root=root)
    (root / "00001.tar").write_bytes(b"x" * (tmp_path / "00001.tar").stat().st_size)
    with pytest.raises(RsaDataError, match=r"00001\.tar: expected a tar"):
        chains.samples(work, "webdataset:photos", {}, root=root)
    (tmp_path / "00001.tar").replace(root / "00001.tar")
    tar_of(root / "00009.tar", {"new.png": b"new"})
    chains.samples(work, "webdataset:photos", {}, root=root)
    table = work.table("photos", "samples")
    assert [receipt.rows for receipt in table.receipts(table.parts())] == [4, 4, 4, 1]
    # Nothing of a tar that has not changed is looked at, but for its size.
    for path in root.iterdir():
        path.write_bytes(b"x" * path.stat().st_size)
    chains.samples(work, "webdataset:photos", {}, root=root)
    assert len(table.parts()) == 4


def test_a_second_shard_with_the_same_key_leaves_nothing_behind(tmp_path):
    root, work = tmp_path / "photos", WorkDir(tmp_path / "work")
    root.mkdir()
    for number in range(2):
        tar_of(root / f"{number}.tar", {"a.png": b"a"})
    with pytest.raises(RsaDataError, match=r"found 0\.tar#\S+ and 1\.tar#\S+ with the same key tr"):
        chains.samples(work, "webdataset:photos", {}, root=root)
    assert not work.table("photos", "samples").exists()


@pytest.mark.parametrize("form", ["tar", "zip", "parquet"])
def test_captions_that_lie_in_the_shards(tmp_path, form):
    write, choice, _ = FORMS[form]
    write(frames(), tmp_path / "photos")
    words = ["captions", "--dataset", choice, "--root", tmp_path / "photos", "--style"]
    work = ["--work", tmp_path / "work"]
    done = CliRunner().invoke(cli, [*map(str, [*words, "member:txt", *work])])
    assert done.exit_code == 0, done.output
    table = WorkDir(tmp_path / "work").table("photos", "captions/member")
    rows = pa.concat_tables([table.read(n) for n in table.parts()])
    expected = [[f"frame {n}"] if n != 8 else ["a", "b ö"] for n in range(10)]
    assert rows["text"].to_pylist() == [text for texts in expected for text in texts]
    assert rows.slice(8, 2)["variant"].to_pylist() == [0, 1]
    done = CliRunner().invoke(cli, [*map(str, [*words, "member:none", "--label", "none", *work])])
    assert done.exit_code == 1 and "texts in members .none" in str(done.exception)


def test_captions_of_shards_that_are_missing_or_no_text(tmp_path):
    (tmp_path / "photos").mkdir()
    members = {f"{k}.png": b"" for k in "abc"} | {"a.txt": b"one", "b.txt": b"\xff\xff"}
    tar_of(tmp_path / "photos" / "0.tar", members)
    words = ["captions", "--dataset", "webdataset:photos", "--root", tmp_path / "photos"]
    work = ["--style", "member:txt", "--work", tmp_path / "work"]
    done = CliRunner().invoke(cli, [*map(str, [*words, *work])])
    assert done.exit_code == 0
    assert "1 image has no text and got 'An image.'" in done.output and "UTF-8" in done.output
    table = WorkDir(tmp_path / "work").table("photos", "captions/member")
    assert table.read(0)["text"].to_pylist() == ["one", "An image.", "An image."]
    (tmp_path / "loose").mkdir()
    (tmp_path / "loose" / "a.png").write_bytes(b"")
    words = ["captions", "--dataset", "folder:loose", "--root", tmp_path / "loose"]
    done = CliRunner().invoke(cli, [*map(str, [*words, *work])])
    assert done.exit_code == 1 and "expected images in shards" in str(done.exception)


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
    (row, *_) = webdataset(members=Members(**options)).index(tmp_path, None).to_pylist()
    assert (row["split"], row["scene"]) == ("val", "kitchen")
    assert [row[k] for k in ("fx", "fy", "cx", "cy")] == [500, 510, 320, 240]
    with pytest.raises(RsaDataError, match=r"json: colour: expected a name"):
        webdataset(members=Members(scene="colour")).index(tmp_path, None)


def test_keys_that_repeat_from_shard_to_shard(tmp_path):
    for number in range(2):
        tar_of(tmp_path / f"{number}.tar", {"a.png": b"a"})
    with pytest.raises(RsaDataError, match="same key train/a"):
        webdataset().index(tmp_path, None)
    rows = webdataset(members=Members(keys="shard/member")).index(tmp_path, None)
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


@pytest.mark.parametrize(("kind", "unit"), [(np.uint16, "mm"), (np.float32, "m"), (np.int32, "mm")])
def test_depth_arrays_as_datasets_keeps_them(tmp_path, kind, unit):
    package = pytest.importorskip("datasets")
    metres = np.random.default_rng(0).uniform(0.5, 9, (2, 20, 30)).round(3)
    metres[0, 0, 0] = 0
    arrays = list((metres * (1000 if unit == "mm" else 1)).round(3).astype(kind))
    features = package.Features({"rgb": package.Image(), "depth": package.Image()})
    rows = {"rgb": [np.zeros((20, 30, 3), np.uint8)] * 2, "depth": arrays}
    made = package.Dataset.from_dict(rows, features=features)
    made.to_parquet(str(tmp_path / "train-00000-of-00001.parquet"))
    dataset = parquet(image="rgb", depth="depth", depth_unit=unit)
    found = dataset.index(tmp_path, None)["depth"].to_pylist()
    for path, expected in zip(found, metres, strict=True):
        np.testing.assert_allclose(dataset.read_depth(tmp_path / path), expected, atol=1e-3)


def test_tiffs_that_are_no_depth_are_refused(tmp_path):
    read = any_file("mm", "depth_unit")
    for name, image in {
        "colour": Image.new("RGB", (4, 4)),
        "grey": Image.new("L", (4, 4)),
        "float": Image.fromarray(np.ones((4, 4), np.float32)),
    }.items():
        image.save(tmp_path / f"{name}.tiff")
    for name in ("colour", "grey"):
        with pytest.raises(
            RowError, match="expected a TIFF with grey of 16 or 32 bits, found mode"
        ):
            read(tmp_path / f"{name}.tiff")
    (tmp_path / "cut.tiff").write_bytes((tmp_path / "float.tiff").read_bytes()[:60])
    with pytest.raises(RowError, match="depth: unreadable TIFF"):
        read(tmp_path / "cut.tiff")
    with pytest.raises(RowError, match="expected integers, counted in steps"):
        any_file("m/256", "depth_unit")(tmp_path / "float.tiff")


def test_splits_of_the_hubs_own_copies_are_told_by_their_folders():
    names = {"default/partial-train/0001.parquet": "train", "default/test/0000.parquet": "test",
             "default/partial-validation/0000.parquet": "val"}  # fmt: skip
    assert {name: split_of(name) for name in names} == names


def test_other_options_are_refused():
    with pytest.raises(UsageError, match="depth and depth_unit go together"):
        open_dataset("webdataset:x", {"depth": "depth.png"})
    with pytest.raises(UsageError, match="parquet: depth_unit: expected m, cm, mm or m/N"):
        open_dataset("parquet:x", {"depth": "d", "depth_unit": "ft"})
    with pytest.raises(UsageError, match="keys: expected member or shard/member"):
        open_dataset("zip:x", {"keys": "other"})
