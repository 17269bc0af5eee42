"""What trainings leave: whole heads, checked by digests, under the description they began with."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from flat import train_head
from made_tables import write

from rsa_data import ScaleHead
from rsa_data.common.errors import RsaDataError
from rsa_data.heads.collection import HEADS
from rsa_data.store.local import LocalStore
from rsa_data.store.tables import WorkDir

FAST = {"epochs": 3, "batch": 16, "pixels": 16, "threads": 1, "head": "linear"}


def images(work: WorkDir, dataset: str = "nyuv2", n: int = 40, scenes: int = 8, **more):
    """n images whose one word tells nothing: enough to train on."""
    rng = np.random.default_rng(0)
    y = rng.uniform(1, 10, (n, 16))
    arrays = {
        "scenes": [f"s{i % scenes}" for i in range(n)],
        "texts": [["a room"]] * n,
        "features": {"a room": rng.normal(size=8).astype(np.float16)},
        "relative": y,
        "metric": 1 / (0.05 * y + 0.1),
    }
    write(work, dataset, **arrays | more)


@pytest.fixture
def work(tmp_path) -> WorkDir:
    work = WorkDir(tmp_path / "work")
    images(work)
    return work


@pytest.mark.parametrize("validation", [1, 1025])
def test_any_number_of_validation_images(work, validation):
    """The last batch of validation may hold one image."""
    scenes = ["train"] * 8 + ["val"] * validation
    n = len(scenes)
    rng = np.random.default_rng(1)
    y = rng.uniform(1, 10, (n, 16))
    for split, rows in (("train", range(8)), ("val", range(8, n))):
        write(
            work, "void", scenes=[scenes[i] for i in rows], texts=[["a"]] * len(rows),
            features={"a": np.ones(8, np.float16)}, relative=y[list(rows)],
            metric=1 / (0.05 * y[list(rows)] + 0.3), split=split, part=2000,
            first_part=0 if split == "train" else 1,
        )  # fmt: skip
    made = train_head(work, name="x", datasets=("void",), **FAST)
    used = made.about.trained_on["void"]
    assert (used.images, used.validation_images) == (8, validation)
    assert used.validation == "the split val"
    lopsided = "warning: void" in made.summary
    assert lopsided == (validation > 8)


def test_what_is_not_the_case_stands_in_no_head(work):
    """As in those of earlier versions: a head of real images says nothing of synthetic ones."""
    about = json.loads(Path(train_head(work, **FAST).path, "head.json").read_text())
    assert about["datasets"]["nyuv2"].keys() == {
        "images", "validation_images", "validation", "min_depth", "max_depth", "tables",
    }  # fmt: skip


def test_a_finished_head_is_not_trained_again(work):
    def bar(title, total):
        raise AssertionError(title)

    about = train_head(work, **FAST).about
    assert train_head(work, bar, **FAST).about == about


def test_a_head_is_out_of_date_once_a_table_of_its_training_changed(work):
    train_head(work, **FAST)
    assert HEADS.names(work) == ["head"] and HEADS.state(work, "head") == ""
    captions = work.table("nyuv2", "captions/occupancy")
    captions.commit(0, captions.read(0).slice(0, 39), captions.receipt(0).made, redo=True)
    assert HEADS.state(work, "head") == (
        "out of date: trained before nyuv2/captions/occupancy changed"
    )
    # Elsewhere, without its datasets, nothing is known against it.
    for name in work.tables("nyuv2"):
        work.table("nyuv2", name).start_over()
    assert HEADS.state(work, "head") == ""


def test_a_training_that_is_pushed_aside_leaves_the_other_ones_head(work):
    begun = []

    class Bar:
        def __init__(self, title, total):
            pass

        def update(self, images):
            if not begun:
                begun.append(train_head(work, seed=1, start_over=True, **FAST))

        def close(self):
            pass

    with pytest.raises(RsaDataError, match="another training has taken this name over"):
        train_head(work, Bar, **FAST)
    about = ScaleHead.load(work.store.folder / "heads/head").about
    assert about.options["seed"] == 1 and about == begun[0].about
    assert list(HEADS.check(work, "head")) == []


@pytest.mark.parametrize("file", ["history.parquet", "head.safetensors", "head.json"])
def test_a_training_pushed_aside_while_it_commits_leaves_the_other_ones_head(work, file):
    """The other one deletes the first one's files and ends between two of its writes."""
    begun = []

    class Store(LocalStore):
        def create(self, path, data):
            if path == f"heads/head/{file}" and not begun:
                begun.append(None)
                begun[0] = train_head(WorkDir(self.folder), seed=1, start_over=True, **FAST)
            return super().create(path, data)

    first = WorkDir(work.store.folder)
    first.store = Store(work.store.folder)
    with pytest.raises(RsaDataError, match="another training has taken this name over"):
        train_head(first, **FAST)
    about = ScaleHead.load(work.store.folder / "heads/head").about
    assert about.options["seed"] == 1 and about == begun[0].about
    assert list(HEADS.check(work, "head")) == []


DAMAGE = {
    "weights": ("head.safetensors", "sha256"),
    "history": ("history.parquet", "history.parquet: damaged"),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_one_flipped_bit_is_noticed(work, what):
    train_head(work, **FAST)
    file, message = DAMAGE[what]
    path = work.store.folder / "heads/head" / file
    data = bytearray(path.read_bytes())
    data[-3] ^= 4
    path.write_bytes(data)
    assert message in " ".join(HEADS.check(work, "head"))


def test_a_description_that_was_edited_is_noticed(work):
    train_head(work, **FAST)
    path = work.store.folder / "heads/head/_table.json"
    about = json.loads(path.read_text())
    about["options"]["seed"] = 7
    path.write_text(json.dumps(about))
    assert "of another training" in " ".join(HEADS.check(work, "head"))


@pytest.mark.parametrize("name", ["mean", "factor", "shift_net.0.weight"])
def test_numbers_that_are_not_finite_are_refused(work, name):
    """Also where the digest fits: a head may come from elsewhere, without one."""
    from safetensors.torch import load_file, save_file

    train_head(work, **FAST)
    folder = work.store.folder / "heads/head"
    tensors = load_file(folder / "head.safetensors")
    tensors[name].view(-1)[0] = float("inf")
    save_file(tensors, folder / "head.safetensors")
    about = json.loads((folder / "head.json").read_text())
    del about["weights"], about["digest"]
    (folder / "head.json").write_text(json.dumps(about))
    with pytest.raises(RsaDataError, match="expected finite weights"):
        ScaleHead.load(folder)


def test_an_output_that_is_not_finite_is_refused(work):
    train_head(work, **FAST)
    head = ScaleHead.load(work.store.folder / "heads/head")
    with torch.no_grad():
        head.network.scale_net[-1].bias.fill_(1e4)
    with pytest.raises(RsaDataError, match="expected a finite scale and shift"):
        head(head.mean.numpy()[None])
