"""train-head: what it learns, what it refuses, and that a kill changes nothing."""

import json
import math
import os
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from flat import train_head
from made_tables import DEPTH, ENCODER, write
from msgspec.structs import replace

from rsa_data import ScaleHead
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.heads.inputs import kinds
from rsa_data.heads.train.plan import Training
from rsa_data.store import schemas
from rsa_data.store.tables import Description, Made, WorkDir

FAST = {"epochs": 6, "batch": 32, "pixels": 32, "threads": 1, "head": "linear", "lr": 0.03}
PAPER = FAST | {"head": "mlp5", "lr": 1e-3}


def toy(work: WorkDir, dataset: str, n: int = 120, size: float = 1.0, rooms: int = 12, **more):
    """n images of 6 kinds of room, whose words tell scale and shift; two variants a caption."""
    rng = np.random.default_rng(list(dataset.encode()))
    kind = rng.integers(6, size=n)
    words = [[f"a {dataset} {k}", f"one {dataset} {k}"] for k in range(6)]
    vectors = {text: rng.normal(size=16) for pair in words for text in pair}
    scale, shift = (0.02 + 0.02 * kind) / size, (0.05 + 0.05 * kind) / size
    y = rng.uniform(0, 10, (n, 64))
    arrays = {
        "scenes": [f"room {i % rooms}" for i in range(n)],
        "texts": [words[k] for k in kind],
        "features": {text: v.astype(np.float16) for text, v in vectors.items()},
        "relative": y,
        "metric": 1 / (scale[:, None] * y + shift[:, None]),
    }
    write(work, dataset, part=50, **arrays | more)


@pytest.fixture
def work(tmp_path) -> WorkDir:
    return WorkDir(tmp_path / "work")


def contents(work: WorkDir, name: str = "head") -> dict[str, bytes]:
    folder = work.store.folder / "heads" / name
    return {f.name: f.read_bytes() for f in sorted(folder.iterdir())}


def test_it_learns_what_the_words_tell_in_rooms_and_streets_at_once(work):
    toy(work, "nyuv2")
    toy(work, "kitti", size=6.0)
    trained = train_head(work, **PAPER | {"epochs": 60, "batch": 16})
    errors = trained.description["validation"]["abs_rel"]
    assert errors["nyuv2"] < 0.05 and errors["kitti"] < 0.05
    head = ScaleHead.load(trained.path)
    rows = work.table("nyuv2", "embeddings/occupancy/minilm").read(0)

    scale, shift = head(schemas.embedding_array(rows))
    assert scale.shape == shift.shape == (len(rows),) and scale.dtype == np.float32
    history = pq.read_table(work.store.folder / "heads/head/history.parquet").to_pylist()
    assert [row["epoch"] for row in history if row["dataset"] == "kitti"] == list(range(1, 61))
    best = [row for row in history if row["best"]]
    assert {row["dataset"]: row["val_abs_rel"] for row in best} == errors


def test_head_json_says_what_the_head_was_made_of(work):
    toy(work, "nyuv2", failed=(3,))
    description = train_head(work, **FAST).description
    assert json.loads(contents(work)["head.json"]) == description
    assert description["features"] == {
        "style": "occupancy",
        "encoder": "minilm",
        "options": {"encoder": "minilm", "normalize": False},
        "files": {},
        "stage_version": 1,
        "dim": 16,
    }
    used = description["datasets"]["nyuv2"]
    assert used["images"] + used["validation_images"] == 119 and used["left_out"] == 1
    assert used["validation"] == "2 of 12 scenes"
    assert set(used["tables"]) == {
        "samples",
        "captions/occupancy",
        "embeddings/occupancy/minilm",
        "depth/files",
    }
    assert description["depth_model"]["geometry"] == {"nyuv2": {"geometry": None, "crop": "none"}}


def test_the_same_seed_gives_the_same_bytes_and_a_finished_head_is_left_alone(work):
    toy(work, "nyuv2")
    train_head(work, name="a", **FAST)
    train_head(work, name="b", **FAST)
    assert contents(work, "a") == contents(work, "b")
    before = contents(work, "a")
    assert train_head(work, name="a", **FAST).description == json.loads(before["head.json"])
    train_head(work, name="c", **FAST, seed=1)
    assert contents(work, "c")["head.safetensors"] != before["head.safetensors"]


@pytest.mark.parametrize("moment", ["checkpoint:1", "checkpoint:4", "rename:5", "write:9"])
def test_a_killed_training_goes_on_to_the_same_bytes(work, moment):
    toy(work, "nyuv2")
    train_head(work, name="whole", **FAST)
    code = (
        "from flat import train_head\n"
        "from rsa_data.store.tables import WorkDir\n"
        f"work = WorkDir({work.store.location!r})\n"
        f"train_head(work, name='killed', checkpoint_every=0, **{FAST!r})"
    )
    env = {**os.environ, "RSA_DATA_FAILPOINT": moment}
    env["PYTHONPATH"] = os.pathsep.join(sys.path)
    died = subprocess.run([sys.executable, "-c", code], env=env, timeout=120)
    assert died.returncode == -9
    train_head(work, name="killed", **FAST)
    assert contents(work, "killed") == contents(work, "whole")


def test_windows_of_a_small_memory_see_every_image_once_an_epoch(work):
    toy(work, "nyuv2")
    toy(work, "kitti", size=6.0)
    counted = []

    class Bar:
        def __init__(self, title, total):
            counted.append(-total)

        def update(self, images):
            counted.append(images)

        def close(self):
            counted.append(0)

    trained = train_head(work, Bar, memory=9e-5, **FAST | {"epochs": 15})
    used = trained.description["datasets"]
    images = used["nyuv2"]["images"] + used["kitti"]["images"]
    assert used["nyuv2"]["images"] + used["nyuv2"]["validation_images"] == 120
    assert counted[0] == -15 * images and sum(counted) == 0 and counted[-1] == 0
    assert max(trained.description["validation"]["abs_rel"].values()) < 0.5


@pytest.mark.parametrize("loss", ["huber", "log-l1", "silog"])
@pytest.mark.parametrize("supervision", ["depth", "both"])
def test_every_loss_learns(work, loss, supervision):
    toy(work, "nyuv2")
    trained = train_head(
        work, loss=loss, supervision=supervision, optimizer="adamw", **FAST | {"epochs": 40}
    )
    assert trained.description["validation"]["abs_rel"]["nyuv2"] < 0.12


def test_patience_stops_early_and_keeps_the_best(work):
    toy(work, "nyuv2")
    description = train_head(work, **FAST | {"epochs": 200}, patience=3).description
    assert description["epochs_run"] < 200
    assert description["epochs_run"] - description["validation"]["epoch"] == 3


def test_one_scene_is_refused_unless_told_to_split_it(work):
    toy(work, "nyuv2", rooms=1)
    with pytest.raises(
        UsageError, match=r"all 120 training images are of one scene.*--split-scene"
    ):
        train_head(work, **FAST)
    used = train_head(work, split_scene=True, **FAST).description["datasets"]["nyuv2"]
    assert used["validation_images"] == 12 and "one block" in used["validation"]


def test_test_splits_are_never_read(work):
    toy(work, "nyuv2", split="test")
    with pytest.raises(RsaDataError, match="found only the test splits test"):
        train_head(work, **FAST)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"encoder": ENCODER | {"normalize": True}}, "options is .*normalize"),
        ({"depth": DEPTH | {"files_hold": "depth"}}, "options is .*files_hold"),
    ],
    ids=["encoder", "depth"],
)
def test_tables_that_do_not_belong_together_are_refused(work, more, message):
    toy(work, "nyuv2")
    toy(work, "kitti", **more)
    with pytest.raises(RsaDataError, match=message):
        train_head(work, **FAST)
    assert train_head(work, datasets=("kitti",), **FAST).description["datasets"].keys() == {"kitti"}


def test_a_head_of_other_options_is_not_overwritten(work):
    toy(work, "nyuv2")
    train_head(work, **FAST)
    before = contents(work)
    with pytest.raises(RsaDataError, match=r"options.seed: the table has 0, this run has 1"):
        train_head(work, **FAST, seed=1)
    assert contents(work) == before
    train_head(work, **FAST, seed=1, start_over=True)
    assert contents(work) != before


def test_captions_made_again_since_are_noticed(work):
    toy(work, "nyuv2")
    table = work.table("nyuv2", "captions/occupancy")
    table.commit(1, table.read(1).slice(2), replace(table.receipt(1), fingerprint="", inputs={}))
    with pytest.raises(
        RsaDataError, match="minilm part 1 was made from another captions/occupancy"
    ):
        train_head(work, **FAST)


def test_missing_tables_say_what_to_run(work):
    with pytest.raises(RsaDataError, match="no dataset there yet"):
        train_head(work)
    toy(work, "nyuv2")
    with pytest.raises(RsaDataError, match=r"no such embeddings table.*rsa-data embed"):
        train_head(work, encoder="clip-rn50")
    with pytest.raises(UsageError, match="unknown dataset in this work dir 'nyu'"):
        train_head(work, datasets=("nyu",))
    with pytest.raises(UsageError, match="unknown head 'mlp'"):
        train_head(work, head="mlp")


def image_features(work: WorkDir, dataset: str, vectors: np.ndarray, missing: int) -> None:
    """embeddings/images/eye of a dataset that `toy` wrote; one image could not be read."""
    table = work.table(dataset, "embeddings/images/eye")
    table.bind(
        Description(
            stage="embed-images",
            schema="image_embeddings",
            options={"encoder": "eye"},
            inputs=["samples"],
        )
    )
    for number in work.table(dataset, "samples").parts():
        samples = work.table(dataset, "samples")
        ids = samples.read(number)["sample_id"].to_pylist()
        rows = [int(i.rpartition("/")[2]) for i in ids]
        field, array = schemas.embedding_column(vectors[rows].astype(np.float32))
        there = [row != missing for row in rows]
        array = pa.array([v if t else None for v, t in zip(array.to_pylist(), there, strict=True)])
        columns = {
            "sample_id": ids,
            "status": ["ok" if t else "failed" for t in there],
            "error": [None if t else "unreadable" for t in there],
            "embedding": (field.with_nullable(True), array.cast(field.type)),
        }
        receipt = {"ok": 1, "failed": 0, "skipped": 0, "split": "train"}
        receipt["inputs"] = {"samples": samples.receipt(number).digest}
        table.commit(number, schemas.from_columns("image_embeddings", columns), Made(**receipt))


@pytest.mark.parametrize("head", ["fusion", "mlp3"])
def test_image_features_stand_beside_those_of_the_text(work, head):
    toy(work, "nyuv2")
    image_features(work, "nyuv2", np.random.default_rng(0).normal(size=(120, 5)) * 30, missing=7)
    made = train_head(work, encoder="minilm+eye", **PAPER | {"head": head}).description
    assert made["features"]["encoder"] == "minilm+eye" and made["features"]["dim"] == 21
    assert [other["encoder"] for other in made["features"]["beside"]] == ["eye"]
    assert made["datasets"]["nyuv2"]["left_out"] == 1
    assert "embeddings/images/eye" in made["datasets"]["nyuv2"]["tables"]
    loaded = ScaleHead.load(work.store.folder / "heads/head")
    # Each table has its own spread, so that the louder one does not drown the other.
    np.testing.assert_allclose(loaded.factor[16:].numpy(), 1 / 30, rtol=0.2)
    np.testing.assert_allclose(loaded.factor[:16].numpy(), 1, rtol=0.3)


def test_features_of_images_are_those_of_their_table(work):
    toy(work, "nyuv2")
    vectors = np.random.default_rng(0).normal(size=(120, 5)).astype(np.float32)
    image_features(work, "nyuv2", vectors, missing=57)
    block = kinds.feed("embeddings/images/eye").read(work, "nyuv2", 1)  # images 50 to 99
    there = np.arange(50) != 7
    np.testing.assert_array_equal(block.there, there)
    rows = np.flatnonzero(there)
    np.testing.assert_array_equal(block.rows(rows, np.zeros(49)), vectors[50:100][there])


def test_a_head_trains_on_image_features_alone(work):
    toy(work, "nyuv2")
    image_features(work, "nyuv2", np.random.default_rng(0).normal(size=(120, 5)), missing=7)
    made = train_head(work, style="images", **FAST).description
    assert made["features"]["encoder"] == "eye" and made["features"]["dim"] == 5
    with pytest.raises(UsageError, match="fusion reads text and image; found --style images"):
        train_head(work, style="images", name="x", **FAST | {"head": "fusion"})
    with pytest.raises(UsageError, match="several embeddings tables; say which"):
        train_head(work, name="x", **FAST)


def test_a_loss_by_its_logarithm_is_that_of_the_datasets_named():
    from rsa_data.heads.train.losses import over_each, over_images

    loss, dataset = torch.tensor([2.0, 4.0, 5.0]), torch.tensor([0, 0, 1])
    log = np.array([True, False])
    assert float(over_images(loss, dataset, log)) == pytest.approx(np.log(3) + 5)
    assert float(over_images(loss, dataset, ~log & log)) == pytest.approx(11 / 3)
    assert float(over_each(loss, dataset, log)) == pytest.approx(np.log(6) + 5)


def test_batches_of_each_dataset_from_parts_that_do_not_fit_at_once(work):
    toy(work, "nyuv2", n=200, rooms=50)
    toy(work, "kitti", n=200, rooms=50, size=6.0)
    options = FAST | {"batches": "each", "epochs": 1}
    # Four parts of each, about 50 kB: three windows, then more than there are parts.
    assert train_head(work, memory=1.2e-4, **options).description["epochs_run"] == 1
    with pytest.raises(RsaDataError, match="expected parts of every dataset in memory at once"):
        train_head(work, name="small", memory=3e-5, **options)


def test_the_options_of_the_released_code_train(work):
    toy(work, "nyuv2")
    toy(work, "kitti", size=6.0)
    made = train_head(
        work,
        loss="huber",
        log_loss=("nyuv2",),
        initial="random",
        standardize=False,
        schedule="polynomial",
        units="metres",
        balance="images",
        **PAPER | {"epochs": 4, "batch": 8, "lr": 3e-4},
    ).description
    assert made["standardized"] is False
    assert made["validation"]["abs_rel"]["nyuv2"] < 5
    with pytest.raises(UsageError, match="unknown dataset in --log-loss 'void'"):
        train_head(work, log_loss=("void",), name="x", **FAST)


def test_a_training_that_blows_up_says_so_and_writes_no_head(work):
    toy(work, "nyuv2")
    with pytest.raises(RsaDataError, match=r"the loss is not finite any more in epoch 1.*--lr"):
        train_head(work, **PAPER | {"lr": 1e30, "batch": 16}, warmup=0.0, clip=0.0)
    assert "head.json" not in contents(work)


@pytest.mark.parametrize(
    ("schedule", "left"),
    [
        ("cosine", lambda done: (1 + math.cos(math.pi * done)) / 2),
        ("polynomial", lambda done: (1 - done) ** 0.9),
    ],
)
def test_the_learning_rate_rises_then_falls(schedule, left):
    training = Training(schedule=schedule, epochs=8, lr=1.0, end_lr=0.1, warmup=1.0)
    rates = [training.learning_rate(epoch) for epoch in (0.49, 2, 4, 8)]
    expected = [0.1 + 0.9 * left(epoch / 8) for epoch in (0.49, 2, 4, 8)]
    np.testing.assert_allclose(rates, [expected[0] / 2, *expected[1:]], rtol=1e-12)


def test_a_broken_checkpoint_is_refused_and_start_over_helps(work):
    toy(work, "nyuv2")
    folder = work.store.folder / "heads/head"
    folder.mkdir(parents=True)
    (folder / "checkpoint.safetensors").write_bytes(b"\x08\0\0\0\0\0\0\0{broken}")
    with pytest.raises(RsaDataError, match=r"checkpoint.safetensors: broken.*--start-over"):
        train_head(work, **FAST)
    assert train_head(work, start_over=True, **FAST).description["epochs_run"] == 6


@pytest.mark.parametrize(("wrong", "found"), [(0.0, "0 m and"), (np.nan, "nan m and")])
def test_depth_that_is_none_is_refused_with_table_and_row(work, wrong, found):
    metric = np.full((120, 64), 2.0)
    metric[70, 3] = metric[90, 5] = wrong
    toy(work, "nyuv2", metric=metric)
    said = rf"nyuv2/depth/files part 1: expected metric depth above 0 m.*found {found} .* in "
    with pytest.raises(RsaDataError, match=said + "nyuv2/train/000070, and 1 more images"):
        train_head(work, **FAST)
    assert "head.json" not in {path.name for path in work.store.folder.rglob("heads/*/*")}


def test_an_image_that_stands_in_two_parts_is_refused(work):
    toy(work, "nyuv2")
    toy(work, "nyuv2", n=60, first_part=3)
    said = "each sample once; found nyuv2/train/000000 in part 0 and in part 3, and 59 more"
    with pytest.raises(RsaDataError, match=said):
        train_head(work, **FAST)
