"""train-head --redraw: swap and delete are drawn anew for every epoch, from the segments."""

import json

import numpy as np
import paper_data
import pyarrow as pa
import pytest
import rooms
from flat import train_head
from made_tables import DEPTH

from rsa_data import registry
from rsa_data.common.errors import UsageError
from rsa_data.runner import jobs, runs, stages
from rsa_data.store import schemas
from rsa_data.store.tables import Description, Made, WorkDir

FAST = {"batch": 8, "pixels": 8, "threads": 1, "validation": 0.3, "precision": "float32"}


@pytest.fixture
def work(tmp_path, monkeypatch) -> WorkDir:
    """Two parts of 12 images: segments, captions in one variant, depth; texts by a tiny tower."""
    monkeypatch.setitem(registry.ENCODERS, "clip-rn50", "paper_data:TEXTS")
    work = rooms.made(tmp_path / "work", parts=2, rows=12)
    runs.run(rooms.captions_job(work, variants=1, delete=0.5), bar=rooms.NoBar)
    embed = stages.bind("embed", {"encoder": "clip-rn50", "threads": 1, "runtime": "torch"})
    runs.run(jobs.job(work, embed, "rooms", upstream="captions/occupancy"), bar=rooms.NoBar)
    depth = work.table("rooms", "depth/files")
    depth.bind(Description(schema="depth", stage="depth", options=DEPTH, inputs=["samples"]))
    samples = work.table("rooms", "samples")
    rng = np.random.default_rng(0)
    for number in (0, 1):
        ids = samples.read(number)["sample_id"]
        y = rng.uniform(1, 9, (len(ids), 8)).astype("<f2")
        values = {
            "sample_id": ids,
            "status": ["ok"] * len(ids),
            "kind": ["pixels"] * len(ids),
            "relative": [row.tobytes() for row in y],
            "metric": [(1 / (0.05 * row + 0.1)).astype("<f2").tobytes() for row in y],
            "fit_scale": [0.05] * len(ids),
            "fit_shift": [0.1] * len(ids),
        }
        names = schemas.schema("depth").names
        rows = schemas.from_columns("depth", {n: values.get(n, [None] * len(ids)) for n in names})
        sample = samples.receipt(number)
        made = Made(
            ok=len(ids), failed=0, skipped=0, split="train", fingerprint="d",
            inputs={"samples": sample.digest},
        )  # fmt: skip
        depth.commit(number, rows, made)
    return work


def test_every_epoch_reads_captions_that_no_table_holds(work, monkeypatch):
    read: list[list[str]] = []
    own = registry.resolve("encoder", registry.ENCODERS, "clip-rn50")

    def load(files):
        model = own.load(files)

        def tokenize(texts):
            read.append(list(texts))
            return model.tokenize(texts)

        return type(model)(**{**vars(model), "tokenize": tokenize})

    monkeypatch.setattr(paper_data, "TEXTS", type(own)(own.doc, own.files, load))
    made = train_head(work, epochs=3, redraw=True, split_scene=True, **FAST)
    assert made.description["options"]["redraw"] is True
    # Each text once an epoch; the other part, a scene by itself, is held out.
    assert len(read) == 3
    stored = set(
        pa.concat_tables(
            work.table("rooms", "captions/occupancy").read(n, ["text"]) for n in (0, 1)
        )["text"].to_pylist()
    )
    epochs = [sorted(texts) for texts in read]
    assert len({json.dumps(texts) for texts in epochs}) == 3
    for texts in epochs:
        new = set(texts) - stored
        assert len(new) >= 3
        # Objects of the image only, some of them deleted, in another order.
        assert all(text.startswith("An image") for text in new)
    again = train_head(work, name="again", epochs=3, redraw=True, split_scene=True, **FAST)
    for file in ("head.safetensors", "history.parquet"):
        assert work.store.read(f"heads/again/{file}") == work.store.read(f"heads/head/{file}")
    assert again.about.validation == made.about.validation


def test_without_it_the_tables_are_read(work):
    plain = train_head(work, epochs=2, split_scene=True, **FAST)
    assert "redraw" not in plain.description["options"]
    drawn = train_head(work, name="drawn", epochs=2, redraw=True, split_scene=True, **FAST)
    assert drawn.about.validation != plain.about.validation


def test_a_head_without_descriptions_is_refused(work):
    with pytest.raises(UsageError, match="--redraw: expected a head that reads captions or object"):
        train_head(work, head="proposals", redraw=True, **FAST)
