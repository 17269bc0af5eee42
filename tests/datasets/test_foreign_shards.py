"""Shards as others' programs leave them, from public reports; see benchmarks/foreign.md."""

import gzip
import io
import tarfile
import zipfile
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image

from rsa_data.common.errors import RsaDataError
from rsa_data.datasets import images
from rsa_data.datasets.index import index, open_dataset
from rsa_data.store.tables import WorkDir

PICTURE = pa.struct({"bytes": pa.binary(), "path": pa.string()})


def jpeg() -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (6, 4), (200, 10, 10)).save(file, "JPEG")
    return file.getvalue()


def indexed(folder: Path, choice: str, **options: Any) -> tuple[dict[str, str | None], str | None]:
    """Key -> image of all samples of the shards in a folder, and what the index says."""
    dataset, kept = open_dataset(f"{choice}:x", options)
    work = WorkDir(folder / "work")
    said = index(work, dataset, kept, root=folder / "in", part_size=9, test_part_size=9)
    table = work.table("x", "samples")
    rows = [row for n in table.parts() for row in table.read(n).to_pylist()]
    return {row["sample_id"].removeprefix("x/train/"): row["image"] for row in rows}, said


def tar(folder: Path, *names: str, form: int = tarfile.PAX_FORMAT) -> None:
    (folder / "in").mkdir(exist_ok=True)
    with tarfile.open(folder / "in" / "a.tar", "w", format=form) as made:
        for name in names:
            data = jpeg() if name.lower().endswith(("jpg", "jpeg")) else b"{}"
            info = tarfile.TarInfo(name)
            info.size = len(data)
            made.addfile(info, io.BytesIO(data))


def parquet(folder: Path, **columns: Any) -> None:
    (folder / "in").mkdir(exist_ok=True)
    pq.write_table(pa.table(columns), folder / "in" / "train-00000-of-00001.parquet")


def test_names_with_dots_are_said(tmp_path):
    tar(tmp_path, "22.05.jpg", "23.05.jpg")
    said = r"found none: 2 samples of a\.tar have no member that ends like an image, such as 22, "
    with pytest.raises(RsaDataError, match=said + r"which has 05\.jpg\. .*image=ENDING"):
        indexed(tmp_path, "webdataset")
    assert not (tmp_path / "work/x/samples").exists()
    found, said = indexed(tmp_path, "webdataset", image="05.jpg")
    assert list(found) == ["22", "23"] and said is None

    (tmp_path / "two").mkdir()
    tar(tmp_path / "two", "0.input.jpg", "0.outputs.txt")
    with pytest.raises(RsaDataError, match=r"such as 0, which has input\.jpg, outputs\.txt"):
        indexed(tmp_path / "two", "webdataset")


def test_a_sample_without_its_image_is_said(tmp_path):
    """Some downloads failed, and one name has a dot in it; members need not be neighbours."""
    tar(tmp_path, "0.jpg", "1.json", "Track 2.0 (Clean).jpg", "2.JPEG", "0.json", "._0.jpg")
    found, said = indexed(tmp_path, "webdataset")
    assert [key for key, image in found.items() if image] == ["0", "2"]
    assert found["1"] is None and found["Track 2"] is None
    assert said and said.startswith("2 samples of a.tar have no member that ends like an image, ")
    assert "such as 1, which has json" in said


@pytest.mark.parametrize("choice", ["webdataset", "zip", "parquet"])
def test_what_lies_in_the_place_of_a_shard(tmp_path, choice):
    ending = {"webdataset": "tar", "zip": "zip", "parquet": "parquet"}[choice]
    (tmp_path / "in").mkdir()
    file = tmp_path / "in" / f"a.{ending}"
    pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 493\n"
    for content, found in (
        (pointer, "found: a pointer of Git LFS in its place; `git lfs pull` gets the file"),
        (b"\n<!DOCTYPE html><html>Log in</html>", "found: a web page or XML"),
        (gzip.compress(bytes(9000)), "found: a gzip file; unpack it"),
        (b"", "found: an empty file. Get it again, or move it away"),
    ):
        file.write_bytes(content)
        with pytest.raises(RsaDataError, match=f"a.{ending}: expected a .*{found}"):
            indexed(tmp_path, choice)
    file.rename(file.with_suffix(f".{ending}.zst"))
    with pytest.raises(RsaDataError, match=r"found a\.\w+\.zst; unpack them first"):
        indexed(tmp_path, choice)


def test_paths_beside_bytes_that_are_no_paths_here(tmp_path):
    paths = ["https://x.org/a.jpg?size=2", "C:\\data\\b.jpg", "/home/me/c.jpg", "../d.jpg", "e.jpg"]
    parquet(tmp_path, image=pa.array([{"bytes": jpeg(), "path": path} for path in paths], PICTURE))
    found, _ = indexed(tmp_path, "parquet")
    numbered = [f"train-00000-of-00001/0000-{row:06d}" for row in range(4)]
    assert list(found) == [*numbered, "e"]
    for image in found.values():
        assert images.read_image(tmp_path / "in" / image).shape == (4, 6, 3)


def test_paths_that_repeat(tmp_path):
    """What push_to_hub leaves of a folder for each class: the last part of each path."""
    rows = [{"bytes": jpeg(), "path": "0001.jpg"}, {"bytes": jpeg(), "path": "0001.jpg"}]
    parquet(tmp_path, image=pa.array(rows, PICTURE))
    with pytest.raises(RsaDataError, match="number the rows by --dataset-option keys=row"):
        indexed(tmp_path, "parquet")
    found, _ = indexed(tmp_path, "parquet", keys="row")
    assert len(found) == 2

    for name in ("b", "c"):
        tar(tmp_path, "0.jpg")
        (tmp_path / "in/a.tar").rename(tmp_path / f"in/{name}.tar")
    with pytest.raises(RsaDataError, match="give --dataset-option keys=shard/member"):
        indexed(tmp_path, "webdataset")


def test_columns_that_are_no_images(tmp_path):
    parquet(tmp_path, image=["/9j/4AAQSkZJRgABAQAAAQABAAD/"])
    with pytest.raises(RsaDataError, match="images as addresses or as text"):
        indexed(tmp_path, "parquet")
    parquet(tmp_path, image=pa.array([[{"bytes": jpeg(), "path": "a"}]], pa.list_(PICTURE)))
    with pytest.raises(RsaDataError, match=r"expected images as .* found list<"):
        indexed(tmp_path, "parquet")
    parquet(tmp_path, label=[1])
    with pytest.raises(RsaDataError, match="or the files that have it by file_list"):
        indexed(tmp_path, "parquet")


def test_archives_of_a_mac(tmp_path):
    (tmp_path / "in").mkdir()
    with zipfile.ZipFile(tmp_path / "in/a.zip", "w") as made:
        made.writestr("photos/0.jpg", jpeg())
        for name in ("__MACOSX/photos/._0.jpg", "photos/.DS_Store"):
            made.writestr(name, b"\0\5\x16\7")
    found, said = indexed(tmp_path, "zip")
    assert list(found) == ["photos/0"] and said is None


def test_parts_of_a_long_shard(tmp_path):
    """Samples go through memory in batches, which do not show in the parts."""
    picture = pa.array([{"bytes": b"", "path": f"{k}.jpg"} for k in range(9000)], PICTURE)
    parquet(tmp_path, image=picture, split=["test" if k % 3 == 0 else "train" for k in range(9000)])
    dataset, kept = open_dataset("parquet:x", {"split": "split"})
    work = WorkDir(tmp_path / "work")
    index(work, dataset, kept, root=tmp_path / "in", part_size=2500, test_part_size=2000)
    table = work.table("x", "samples")
    sizes = [(receipt.split, receipt.rows) for receipt in table.receipts(table.parts())]
    assert sizes == [
        ("train", 2500), ("train", 2500), ("train", 1000), ("test", 2000), ("test", 1000),
    ]  # fmt: skip
    ids = [i for n in range(3) for i in table.read(n)["sample_id"].to_pylist()]
    assert ids == [f"x/train/{k}" for k in range(9000) if k % 3]
