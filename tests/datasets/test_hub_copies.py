"""Datasets by their copies on the Hugging Face hub, which need no --root."""

import io
import json
import os
import shutil
import subprocess
import sys
import zipfile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hub_server import hub, surroundings
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from shard_files import frames

from rsa_data.datasets.index import load_dataset
from rsa_data.store.tables import WorkDir


def splits(work: WorkDir, dataset: str) -> dict[str, int]:
    samples = work.table(dataset, "samples")
    return {r.split: r.rows for r in samples.receipts(samples.parts())}


@pytest.fixture
def ask(tmp_path):
    """Runs embed-images on a data set, whose files lie in the folder hub of tmp_path."""

    def run(name: str, *words: str) -> subprocess.CompletedProcess[str]:
        with hub(tmp_path / "hub", name) as address:
            command = [sys.executable, "-m", "rsa_data", "embed-images", "--dataset", *words]
            return subprocess.run(
                [*command, "--encoder", "thumbnail", "--work", str(tmp_path / "work")],
                env=os.environ | surroundings(address, tmp_path / "cache"),
                capture_output=True, text=True, timeout=300, check=False,
            )  # fmt: skip

    return run


def test_named_copies_on_the_hub_need_no_root(tmp_path, ask):
    """A stand-in for each copy: its columns as those have them who read it."""
    pictures = [parts["png"] for parts in frames().values()]
    depths = [parts.get("depth.png") for parts in frames().values()]

    def column(found):
        return [{"bytes": data, "path": None} for data in found]

    (tmp_path / "hub" / "data").mkdir(parents=True)
    for split in ("train", "test"):
        place = tmp_path / f"hub/data/{split}-00000-of-00001.parquet"
        pq.write_table(pa.table({"rgb": column(pictures), "depth": column(depths)}), place)
    done = ask("jagennath-hari/nyuv2", "nyuv2-parquet")
    assert done.returncode == 0, done.stderr
    work = WorkDir(tmp_path / "work")
    assert splits(work, "nyuv2-parquet") == {"train": 10, "test": 10}
    kept = (tmp_path / "work/nyuv2-parquet/root.txt").read_text()
    assert kept == f"hf://datasets/jagennath-hari/nyuv2@{'c' * 40}"

    # The hub's own conversion, its depth as `datasets` writes an array of floats.
    shutil.rmtree(tmp_path / "hub")
    metres = np.linspace(0.5, 9, 40 * 60, dtype=np.float32).reshape(40, 60)
    file = io.BytesIO()
    Image.fromarray(metres).save(file, "TIFF")
    made = pa.table({"image": column(pictures), "depth_map": column([file.getvalue()] * 10)})
    for split in ("partial-train", "partial-validation"):
        (tmp_path / "hub/default" / split).mkdir(parents=True)
        pq.write_table(made, tmp_path / f"hub/default/{split}/0000.parquet")
    done = ask("sayakpaul/nyu_depth_v2", "nyuv2-fastdepth")
    assert done.returncode == 0, done.stderr
    work = WorkDir(tmp_path / "work")
    assert splits(work, "nyuv2-fastdepth") == {"train": 10, "val": 10}
    dataset = load_dataset(work, "nyuv2-fastdepth")
    assert dataset.role("val") == "test"
    place = work.table("nyuv2-fastdepth", "samples").read(0)["depth"][0].as_py()
    np.testing.assert_array_equal(dataset.read_depth(tmp_path / "hub" / place), metres)


def moge_depth(metres: np.ndarray) -> bytes:
    """Depth as MoGe's write_depth keeps it: equal steps of log depth, nan 0, inf 65535."""
    near, far = metres[np.isfinite(metres)].min(), metres[np.isfinite(metres)].max()
    share = np.log(np.where(np.isfinite(metres), metres, near) / near) / np.log(far / near)
    values = 1 + np.round(share * 65533).astype(np.uint16)
    values[np.isnan(metres)], values[np.isinf(metres)] = 0, 65535
    text, file = PngInfo(), io.BytesIO()
    text.add_text("near", str(near))
    text.add_text("far", str(far))
    Image.fromarray(values).save(file, "PNG", pnginfo=text)
    return file.getvalue()


def test_benchmarks_as_moge_prepared_them(tmp_path, ask):
    rng = np.random.default_rng(0)
    metres = rng.uniform(0.4, 9.5, (40, 60))
    metres[0], metres[1] = np.nan, np.inf
    photo = io.BytesIO()
    Image.fromarray(rng.integers(0, 255, (40, 60, 3), np.uint8)).save(photo, "JPEG")
    about = json.dumps({"intrinsics": [[1.5, 0, 0.5], [0, 2.25, 0.5], [0, 0, 1]]})
    (tmp_path / "hub").mkdir()
    with zipfile.ZipFile(tmp_path / "hub/NYUv2.zip", "w") as archive:
        archive.writestr("NYUv2/.index.txt", "kitchen/0001\nkitchen/0000\noffice/0000\n")
        for key in ("kitchen/0000", "kitchen/0001", "kitchen/unlisted", "office/0000"):
            archive.writestr(f"NYUv2/{key}/image.jpg", photo.getvalue())
            archive.writestr(f"NYUv2/{key}/depth.png", moge_depth(metres))
            archive.writestr(f"NYUv2/{key}/meta.json", about)
    done = ask(
        "Ruicheng/monocular-geometry-evaluation",
        "moge:nyu-test",
        "--dataset-option",
        "benchmark=NYUv2",
    )
    assert done.returncode == 0, done.stderr
    work = WorkDir(tmp_path / "work")
    wrong = ask(
        "Ruicheng/monocular-geometry-evaluation", "moge:x", "--dataset-option", "benchmark=Sintel"
    )
    assert wrong.returncode == 2 and "NYUv2" in wrong.stderr  # no scale: not among the choices
    rows = work.table("nyu-test", "samples").read(0).to_pylist()
    ids = [row["sample_id"].removeprefix("nyu-test/test/") for row in rows]
    assert ids == ["kitchen/0001", "kitchen/0000", "office/0000"]
    assert [row["scene"] for row in rows] == ["kitchen", "kitchen", "office"]
    assert [rows[0][c] for c in ("fx", "fy", "cx", "cy", "width", "height")] == [
        90.0, 90.0, 30.0, 20.0, 60, 40,
    ]  # fmt: skip
    found = load_dataset(work, "nyu-test").read_depth(tmp_path / "hub" / rows[0]["depth"])
    assert not found[:2].any()
    np.testing.assert_allclose(found[2:], metres[2:], rtol=3e-5)  # half a step of log(9.5 / 0.4)
