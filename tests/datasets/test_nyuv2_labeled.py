"""The labelled frames of NYUv2 from a small MATLAB file of the same structure."""

import cv2
import numpy as np
import pytest

from rsa_data.common import names_files
from rsa_data.common.errors import RsaDataError
from rsa_data.datasets.images import read_image
from rsa_data.datasets.nyuv2 import CAMERA
from rsa_data.datasets.nyuv2_labeled import nyuv2_labeled
from rsa_data.store import schemas

h5py = pytest.importorskip("h5py")
scipy_io = pytest.importorskip("scipy.io")

SCENES = ["kitchen_0004", "bathroom_0001a", "bathroom_0001b"]
NAMES = ["wall", "air-conditioner", 'the "best" chair']
RNG = np.random.default_rng(0)
IMAGES = RNG.integers(0, 256, (3, 6, 8, 3), np.uint8)
DEPTHS = np.round(RNG.uniform(0.5, 9.9, (3, 6, 8)), 4).astype(np.float32)
DEPTHS[:, 0] = 0
LABELS = RNG.integers(0, 4, (3, 6, 8)).astype(np.uint16)


@pytest.fixture
def root(tmp_path):
    """Frames of 6 x 8 px; the arrays lie as MATLAB 7.3 stores them, last axis first."""
    with h5py.File(tmp_path / "nyu_depth_v2_labeled.mat", "w") as file:
        file["images"] = IMAGES.transpose(0, 3, 2, 1)
        file["rawDepths"] = DEPTHS.transpose(0, 2, 1)
        file["labels"] = LABELS.transpose(0, 2, 1)
        for name, texts in (("scenes", SCENES), ("names", NAMES)):
            cells = file.create_dataset(name, (1, len(texts)), h5py.ref_dtype)
            for i, text in enumerate(texts):
                codes = np.array([[ord(c)] for c in text], np.uint16)
                cells[0, i] = file.create_dataset(f"#refs#/{name}{i}", data=codes).ref
    splits = {"trainNdxs": np.array([[1]]), "testNdxs": np.array([[2], [3]])}
    scipy_io.savemat(tmp_path / "splits.mat", splits)
    return tmp_path


def row(split, scene, room, number):
    image = f"{split}/{scene}/rgb_{number:05d}.png"
    return {
        "sample_id": f"nyuv2-labeled/{image.removesuffix('.png')}",
        "dataset": "nyuv2-labeled",
        "split": split,
        "scene": room,
        "image": image,
        "depth": image.replace("rgb", "sync_depth"),
        "width": None,
        "height": None,
        **dict(zip(("fx", "fy", "cx", "cy"), CAMERA, strict=True)),
    }


ROWS = [
    row("test", "bathroom_0001a", "bathroom_0001", 1),
    row("test", "bathroom_0001b", "bathroom_0001", 2),
    row("train", "kitchen_0004", "kitchen_0004", 0),
]


def test_unpacked_frames_are_those_of_the_file(root):
    dataset = nyuv2_labeled()
    dataset.prepare(root)
    table = dataset.index(root, None)
    schemas.check("samples", table)
    assert table.to_pylist() == ROWS
    for r in ROWS:
        i = int(r["image"][-9:-4])
        np.testing.assert_array_equal(read_image(root / r["image"]), IMAGES[i])
        np.testing.assert_allclose(dataset.read_depth(root / r["depth"]), DEPTHS[i], atol=1.01e-4)
        label = cv2.imread(str(root / "labels" / r["image"]), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(label, LABELS[i])
        key = r["sample_id"].split("/", 2)[2]
        assert dataset.key_paths(r["split"], key) == (r["image"], r["depth"])
    names = names_files.read(root / "names.toml").names
    assert names == {1: "wall", 2: "air-conditioner", 3: 'the "best" chair'}


def test_a_stopped_unpacking_goes_on_and_a_finished_one_needs_no_file(root):
    dataset = nyuv2_labeled()
    dataset.prepare(root)
    before = {p: p.read_bytes() for p in root.rglob("*") if p.is_file()}
    for name in ("names.toml", "labels/test/bathroom_0001a/rgb_00001.png"):
        (root / name).unlink()
    (root / "test/bathroom_0001a/rgb_00001.png").write_bytes(b"half")
    dataset.prepare(root)
    assert {p: p.read_bytes() for p in root.rglob("*") if p.is_file()} == before
    (root / "nyu_depth_v2_labeled.mat").unlink()
    dataset.prepare(root)


def test_missing_and_damaged_files_are_named(root):
    (root / "splits.mat").unlink()
    with pytest.raises(RsaDataError, match=r"expected splits\.mat, found neither .*list datasets"):
        nyuv2_labeled().prepare(root)
    (root / "splits.mat").write_bytes(b"not a MATLAB file")
    with pytest.raises(RsaDataError, match=r"splits\.mat as NYU gives them, found: "):
        nyuv2_labeled().prepare(root)
    scipy_io.savemat(root / "splits.mat", {"testNdxs": np.array([[1]])})
    data = (root / "nyu_depth_v2_labeled.mat").read_bytes()
    (root / "nyu_depth_v2_labeled.mat").write_bytes(data[: len(data) // 2])
    with pytest.raises(RsaDataError, match=r"as NYU gives them, found: .*truncated"):
        nyuv2_labeled().prepare(root)
