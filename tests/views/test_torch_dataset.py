"""ShardDataset against the tables it reads; the trainer of docs/pytorch.md against train_head."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from flat import train_head
from made_tables import write
from torch.utils.data import DataLoader

import rsa_data
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.store import schemas
from rsa_data.store.tables import WorkDir

PAGE = (Path(__file__).parents[2] / "docs" / "pytorch.md").read_text("utf-8")


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> WorkDir:
    """240 images of 6 kinds of room in 5 parts, whose words tell scale and shift."""
    work = WorkDir(tmp_path_factory.mktemp("work"))
    rng = np.random.default_rng(0)
    kind = rng.integers(6, size=240)
    words = [[f"a {k}", f"one {k}"] for k in range(6)]
    vectors = {t: rng.normal(size=16).astype(np.float16) for pair in words for t in pair}
    y = rng.uniform(0, 10, (240, 64))
    scale, shift = 0.02 + 0.02 * kind, 0.05 + 0.05 * kind
    write(
        work, "nyuv2", part=50, scenes=[f"room {i % 24}" for i in range(240)],
        texts=[words[k] for k in kind], features=vectors, relative=y,
        metric=1 / (scale[:, None] * y + shift[:, None]), failed=(7,),
    )  # fmt: skip
    return work


@pytest.fixture
def data(work):
    return rsa_data.ShardDataset(work, "nyuv2")


def test_items_are_the_rows_of_the_tables(work, data):
    assert len(data) == 239
    ids = [data[i]["sample_id"] for i in range(len(data))]
    expected = [f"nyuv2/train/{i:06d}" for i in range(240) if i != 7]
    assert ids == expected
    depth = work.table("nyuv2", "depth/files").read(1).to_pylist()[3]
    item = data[ids.index(depth["sample_id"])]
    np.testing.assert_array_equal(item["relative"], np.frombuffer(depth["relative"], "<f2"))
    np.testing.assert_array_equal(item["metric"], np.frombuffer(depth["metric"], "<f2"))
    np.testing.assert_allclose(item["fit"], [depth["fit_scale"], depth["fit_shift"]], rtol=1e-6)
    captions = work.table("nyuv2", "captions/occupancy").read(1).to_pylist()
    embeddings = work.table("nyuv2", "embeddings/occupancy/minilm").read(1)
    row = next(c for c in captions if c["sample_id"] == depth["sample_id"] and c["variant"] == 0)
    place = embeddings["text_id"].to_pylist().index(row["text_id"])
    np.testing.assert_array_equal(item["feature"], schemas.embedding_array(embeddings)[place])
    assert {k: v.dtype for k, v in item.items() if k != "sample_id"} == dict.fromkeys(
        ("feature", "relative", "metric", "fit"), np.dtype(np.float32)
    )
    assert data[-1]["sample_id"] == expected[-1]
    with pytest.raises(IndexError):
        data[239]


@pytest.mark.parametrize("workers", [0, 2])
def test_a_stream_gives_every_image_once_an_epoch_in_another_order(data, workers):
    def epoch(number):
        stream = data.stream(batch_size=32, window=2, seed=3)
        stream.set_epoch(number)
        batches = list(DataLoader(stream, batch_size=None, num_workers=workers))
        assert all(isinstance(b["feature"], torch.Tensor) for b in batches)
        return [i for b in batches for i in b["sample_id"]]

    first, second = epoch(0), epoch(1)
    assert sorted(first) == sorted(second) == [data[i]["sample_id"] for i in range(239)]
    assert first != second and first == epoch(0)


def test_ranks_divide_the_parts(data, monkeypatch):
    monkeypatch.setattr(torch.distributed, "is_initialized", lambda: True)
    monkeypatch.setattr(torch.distributed, "get_world_size", lambda: 3)
    seen = []
    for rank in range(3):
        monkeypatch.setattr(torch.distributed, "get_rank", lambda rank=rank: rank)
        seen.append({item["sample_id"] for item in data.stream()})
    assert sum(map(len, seen)) == len(set.union(*seen)) == 239


@pytest.mark.parametrize("batch_size", [None, 16])
def test_it_continues_within_an_epoch(data, batch_size):
    stream = data.stream(batch_size=batch_size, seed=1)
    stream.set_epoch(4)
    whole = [item["sample_id"] for item in stream]
    stream.set_epoch(4)
    begun = iter(stream)
    first = [next(begun)["sample_id"] for _ in range(5)]
    other = data.stream(batch_size=batch_size, seed=1)
    other.load_state_dict(stream.state_dict())
    assert other.state_dict() == stream.state_dict()  # a second stop before the first image
    assert first + [item["sample_id"] for item in other] == whole


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"seed": 2}, "with seed 1; found 2"),
        ({"window": 3}, "with window 4; found 3"),
        ({"batch_size": 8}, "with batch_size 16; found 8"),
        ({"shuffle": False}, "with shuffle True; found False"),
        ({"keep": [True] * 238 + [False]}, "with images "),
        ({"process": "0 of 2"}, "with process 0 of 1; found 0 of 2"),
        ({"taken": -1}, "each 0 or more; found 0 and -1"),
        ({"epoch": "0"}, "each 0 or more; found '0' and 0"),
    ],
)
def test_a_state_of_another_order_is_refused(data, change, found):
    made = {"batch_size": 16, "seed": 1}
    own = {key: value for key, value in change.items() if key not in ("process", "taken", "epoch")}
    state = data.stream(**made | own).state_dict() | {k: change[k] for k in change.keys() - own}
    with pytest.raises(UsageError, match=found):
        data.stream(**made).load_state_dict(state)


def test_images_that_are_left_out(data):
    held = data.held_out(0.2)
    kept = {item["sample_id"] for item in data.stream(keep=~held)}
    assert kept == {data[i]["sample_id"] for i in np.flatnonzero(~held)}
    assert not set(data.scenes()[held]) & set(data.scenes()[~held])
    with pytest.raises(UsageError, match="expected 239 values, found 3"):
        data.stream(keep=[True] * 3)


def test_what_is_not_whole_is_refused(work, tmp_path):
    shutil.copytree(work.store.location, tmp_path / "work")
    copy = WorkDir(tmp_path / "work")
    table = copy.table("nyuv2", "depth/files")
    (tmp_path / "work" / "nyuv2" / "depth" / "files" / "_part-00002.json").unlink()
    with pytest.raises(RsaDataError, match="1 of 5 parts of the split train are not done"):
        rsa_data.ShardDataset(copy, "nyuv2")
    with pytest.raises(UsageError, match="expected one of train"):
        rsa_data.ShardDataset(work, "nyuv2", split="test")
    assert table.exists()


def test_choices_that_are_not_there_are_told_when_the_dataset_opens(work, data, tmp_path):
    with pytest.raises(RsaDataError, match="expected a work dir; found no dataset in it"):
        rsa_data.ShardDataset(tmp_path, "nyuv2")
    with pytest.raises(RsaDataError, match=r"clip-rn50.*found occupancy/minilm") as error:
        rsa_data.ShardDataset(work, "nyuv2", encoder="clip-rn50")
    assert "--encoder clip-rn50" in str(error.value)  # of the command that makes the table
    write(
        WorkDir(tmp_path / "work"), "nyuv2", scenes=["s"] * 2, texts=[["a"]] * 2,
        features={"a": np.zeros(4, np.float16)}, relative=np.ones((2, 64)), metric=np.ones((2, 64)),
        split="test", size=(8, 8),
    )  # fmt: skip
    with pytest.raises(UsageError, match=r"expected sampled pixels.*found whole maps.*pytorch.md"):
        rsa_data.ShardDataset(tmp_path / "work", "nyuv2", split="test")
    for share in (0, 2, "x"):
        with pytest.raises(UsageError, match=r"more than 0, at most 0\.5; found"):
            data.held_out(share)
    for given in ({"keep": [2] * 239}, {"window": 1.5}, {"batch_size": 0}):
        with pytest.raises(UsageError, match="stream: "):
            data.stream(**given)
    with pytest.raises(UsageError, match="expected what state_dict gave"):
        data.stream().load_state_dict(None)


def test_the_state_of_copies_in_loader_workers_is_not_known_here(data):
    stream = data.stream(batch_size=32)
    assert stream.state_dict()["taken"] == 0
    batches = iter(DataLoader(stream, batch_size=None, num_workers=2))
    next(batches)
    with pytest.raises(UsageError, match="copies of this stream: ask torchdata's"):
        stream.state_dict()
    del batches
    stream.set_epoch(1)
    assert stream.state_dict()["epoch"] == 1


@pytest.mark.filterwarnings("ignore:.set_vital. is deprecated")  # torchdata calls it
def test_the_checkpoint_of_the_page_continues_within_an_epoch(work, data, tmp_path):
    pytest.importorskip("torchdata")
    code = re.search(r"<!-- example: checkpoint -->\n```python\n(.*?)```", PAGE, re.DOTALL)[1]
    names = {"WORK": work.store.location, "CHECKPOINT": tmp_path / "training.pt"}
    exec(code, names)
    assert len(names["seen"]) == 239
    assert sorted(names["seen"]) == [data[i]["sample_id"] for i in range(239)]


def test_more_loader_workers_than_parts_are_told(data, monkeypatch):
    monkeypatch.setattr(torch.distributed, "is_initialized", lambda: True)
    monkeypatch.setattr(torch.distributed, "get_world_size", lambda: 6)
    monkeypatch.setattr(torch.distributed, "get_rank", lambda: 0)
    with pytest.warns(UserWarning, match="6 loader workers for 5 parts"):
        list(data.stream(batch_size=32))


@pytest.mark.slow
def test_the_trainer_of_the_page_reaches_the_error_of_train_head(work, tmp_path):
    blocks = dict(re.findall(r"<!-- example: (\w+) -->\n```python\n(.*?)```", PAGE, re.DOTALL))
    code = blocks["trainer"]
    assert len([line for line in code.splitlines() if line.strip()]) <= 32
    names = {"WORK": work.store.location, "EPOCHS": 40}
    exec(code, names)
    made = train_head(work, epochs=40, batch=16, pixels=64, validation=0.1, threads=1, lr=3e-3)
    theirs = made.description["validation"]["abs_rel"]["nyuv2"]
    assert names["error"] < max(1.2 * theirs, theirs + 0.01), (names["error"], theirs)

    # Test images of the same kinds of room, as whole maps.
    shutil.copytree(work.store.location, tmp_path / "work")
    rng = np.random.default_rng(1)
    texts = work.table("nyuv2", "captions/occupancy").read(0).slice(0, 2)["text"].to_pylist()
    embeddings = work.table("nyuv2", "embeddings/occupancy/minilm").read(0)
    ids = work.table("nyuv2", "captions/occupancy").read(0).slice(0, 2)["text_id"].to_pylist()
    rows = [embeddings["text_id"].to_pylist().index(i) for i in ids]
    vectors = dict(zip(texts, schemas.embedding_array(embeddings)[rows], strict=True))
    kind = int(texts[0][-1])
    y = rng.uniform(0, 10, (3, 64))
    metric = 1 / ((0.02 + 0.02 * kind) * y + 0.05 + 0.05 * kind)
    write(
        WorkDir(tmp_path / "work"), "nyuv2", scenes=["s"] * 3, texts=[texts] * 3, features=vectors,
        relative=y, metric=metric, split="test", first_part=5, size=(8, 8),
    )  # fmt: skip
    names["WORK"] = str(tmp_path / "work")
    exec(blocks["measured"], names)
    assert len(names["errors"]) == 3 and names["abs_rel"] < 2 * names["error"] + 0.05
