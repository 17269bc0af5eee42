"""robustness: captions written anew from the same segments, with what is wrong in them."""

import shutil

import numpy as np
import pytest
import rooms
from flat import evaluate, robustness, train_head
from made_tables import DEPTH
from msgspec.structs import replace

from rsa_data import ScaleHead
from rsa_data.captions import write
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.common.options import RenamedOption, call
from rsa_data.evaluation import robustness as robustness_module
from rsa_data.evaluation.robustness import CHANGES, OBJECT_CHANGES, other_captions
from rsa_data.evaluation.setting import tables_of
from rsa_data.heads.belong import Tables
from rsa_data.heads.inputs.objects import NUMBERS, Objects
from rsa_data.runner import jobs, runs, stages
from rsa_data.store import schemas
from rsa_data.store.tables import Description, Made, WorkDir

# A folder reaches as far as a street unless it says otherwise.
NAMES = [name.format(here="outdoor", there="indoor") for name in CHANGES]
FAST = {"epochs": 1, "batch": 8, "pixels": 16, "threads": 1, "validation": 0.3}


def with_split(table, split):
    columns = {name: table[name] for name in table.column_names}
    columns["split"] = [split] * len(table)
    return schemas.from_columns("samples", columns)


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> WorkDir:
    """12 training and 6 test images of one dataset, segments to heads, by the real stages."""
    work = rooms.made(tmp_path_factory.mktemp("work"), parts=2, rows=9)
    samples = work.table("rooms", "samples")
    kept = {k: getattr(samples.receipt(1), k) for k in ("ok", "failed", "skipped")}
    test = with_split(samples.read(1), "test")
    samples.commit(1, test, Made(**kept, split="test", fingerprint="test"))
    samples.manifest([0, 1])
    segments = work.table("rooms", "segments/labels")
    made_from = {"inputs": {"samples": samples.receipt(1).digest}, "fingerprint": "test"}
    segments.commit(1, segments.read(1), Made(**kept, split="test", **made_from))
    segments.manifest([0, 1])

    options = {"variants": 2, "tokenizer": "minilm"}
    runs.run(rooms.captions_job(work, **options), bar=rooms.NoBar)
    embed = {"encoder": "minilm", "threads": 1}
    job = jobs.job(work, stages.bind("embed", embed), "rooms", upstream="captions/occupancy")
    runs.run(job, bar=rooms.NoBar)

    depth = work.table("rooms", "depth/files")
    depth.bind(Description(schema="depth", stage="depth", options=DEPTH, inputs=["samples"]))
    rng = np.random.default_rng(0)
    for number in (0, 1):
        rows = samples.read(number)
        y = rng.uniform(1, 9, (9, 20)).astype("<f2")
        metric = (1 / (0.05 * y.astype(float) + 0.1)).astype("<f2")
        values = {
            "sample_id": rows["sample_id"],
            "status": ["ok"] * 9,
            "kind": ["map" if number else "pixels"] * 9,
            "width": [5] * 9,
            "height": [4] * 9,
            "relative": [row.tobytes() for row in y],
            "metric": [row.tobytes() for row in metric],
            "fit_scale": [0.05] * 9,
            "fit_shift": [0.1] * 9,
        }
        columns = {n: values.get(n, [None] * 9) for n in schemas.schema("depth").names}
        sample = samples.receipt(number)
        receipt = replace(sample.made, inputs={"samples": sample.digest}, fingerprint="d")
        depth.commit(number, schemas.from_columns("depth", columns), receipt)
    train_head(work, split_scene=True, **FAST)
    listing = stages.bind("embed-objects", {"encoder": "minilm"})
    runs.run(jobs.job(work, listing, "rooms", upstream="segments/labels"), bar=rooms.NoBar)
    for head in ("objects", "text-objects"):
        train_head(work, name=head, head=head, split_scene=True, **FAST)
    return work


def scales(found):
    """Scale of each image in the order of samples, by change."""
    assert set(found["status"]) == {"ok"}
    return {name: rows["scale"].to_numpy() for name, rows in found.groupby("method", sort=False)}


def test_a_head_that_reads_objects_gets_the_same_changes(work):
    by_method = scales(robustness(work, head="objects").table.to_pandas())
    assert list(by_method) == [*NAMES, *OBJECT_CHANGES]
    head = evaluate(work, head="objects").table.to_pandas()
    plain = head[head["method"] == "head"]["scale"].to_numpy()
    # The segments of this dataset are things without places.
    for same in ("plain", "order swapped", "things only", "places hidden"):
        np.testing.assert_allclose(by_method[same], plain, rtol=1e-5)
    for none in ("nothing found", "background only"):
        assert len(set(by_method[none])) == 1
    # Of images with 0 to 4 objects, all but the empty ones change.
    for change in ("outdoor described as indoor", "3 wrong added", "list of names"):
        assert (~np.isclose(by_method[change], plain, rtol=1e-6)).sum() >= 6

    both = scales(robustness(work, head="text-objects").table.to_pandas())
    own = evaluate(work, head="text-objects").table.to_pandas()
    own = own[own["method"] == "head"]["scale"].to_numpy()
    np.testing.assert_allclose(both["plain"], own, rtol=1e-5)
    # Another order changes a sentence, the objects of the other domain change both inputs.
    assert (both["order swapped"] != own).any()
    assert (both["outdoor described as indoor"] != both["order swapped"]).sum() >= 5


@pytest.mark.slow
def test_each_change_is_measured_on_every_image(work):
    found = robustness(work).table.to_pandas()
    assert list(found["method"].unique()) == NAMES
    assert set(found["status"]) == {"ok"}
    by_method = {name: rows.reset_index(drop=True) for name, rows in found.groupby("method")}

    head = evaluate(work).table.to_pandas()
    head = head[head["method"] == "head"].reset_index(drop=True)
    np.testing.assert_allclose(by_method["plain"]["scale"], head["scale"], rtol=1e-5)

    assert by_method["nothing found"]["scale"].nunique() == 1
    np.testing.assert_allclose(by_method["things only"]["scale"], head["scale"], rtol=1e-5)
    # Every segment of this dataset is a thing.
    np.testing.assert_allclose(
        by_method["background only"]["scale"], by_method["nothing found"]["scale"], rtol=1e-5
    )
    for change, least in (("half deleted", 2), ("3 wrong added", 7)):
        other = ~np.isclose(by_method[change]["scale"], head["scale"], rtol=1e-6)
        assert other.sum() >= least
    summary = robustness(work).summary
    assert "rooms: nothing found:" in summary and "rooms: plain:" not in summary


def test_changes_are_options_of_captions_that_do_what_their_names_say():
    ids = [f"rooms/train/000/{n:05d}" for n in range(400)]
    given = rooms.segment_rows(ids), rooms.sample_rows(ids)
    kept, added = {}, {}
    plain = call(write.build, variants=2, max_tokens=0)(*given).to_pylist()
    before = sum(row["n_objects"] for row in plain if row["variant"] == 1)
    for name, (options, variant) in CHANGES.items():
        made = call(
            write.build, **{"variants": 2, "max_tokens": 0} | options | {"domain": "street"}
        )
        rows = [row for row in made(*given).to_pylist() if row["variant"] == variant]
        kept[name] = sum(row["n_kept"] for row in rows) / before
        added[name] = sum(row["n_objects"] for row in rows) - before
    # Of 800 objects: 5 standard deviations of a half are 0.09; one object of each image is spared.
    assert 0.5 < kept["half deleted"] < 0.5 + 0.09 + 0.1
    assert 0.7 < kept["a fifth deleted"] < 0.9
    assert kept["order swapped"] == kept["all replaced"] == kept["things only"] == 1
    assert kept["background only"] == 0
    assert [added[f"{n} wrong added"] for n in (1, 3)] == [400, 1200]


def test_what_a_head_of_objects_is_told_less_of():
    known = np.ones((2, len(NUMBERS)), np.float32)
    objects = Objects(np.eye(2), np.array([0, 0]), known, np.array([0, 2]), np.ones(1, bool))
    left = {}
    for name, less in OBJECT_CHANGES.items():
        found = less(objects)
        told = dict(zip(NUMBERS, found.numbers.T, strict=True))
        left[name] = (len(found.name), told["share known"].any(), told["place known"].any())
    assert left == {
        "places hidden": (2, True, False),
        "shares and places hidden": (2, False, False),
        "list of names": (1, False, False),
    }


def test_the_old_name_of_an_option_holds_for_one_version(work, tmp_path):
    with (
        pytest.warns(RenamedOption, match="--weights is now --encoder-weights"),
        pytest.raises(RsaDataError, match="expected a head"),
    ):
        robustness_module.robustness(work, head="none", weights=tmp_path / "x")


def test_a_control_does_not_read_descriptions(work):
    train_head(work, name="shuffled", control="shuffled", split_scene=True, **FAST)
    with pytest.raises(UsageError, match="control"):
        robustness(work, head="shuffled")


def test_other_captions_of_the_same_encoder_are_measured(work, tmp_path):
    shutil.copytree(work.store.location, tmp_path / "work")
    work = WorkDir(tmp_path / "work")
    head = ScaleHead.load(tmp_path / "work" / "heads" / "head")
    (source,) = tables_of(work, head.about, Tables(("rooms",))).values()
    assert other_captions(work, head, source) == {}
    for style, normalize in (("counts", False), ("classes", True)):
        runs.run(rooms.captions_job(work, style=style, tokenizer="minilm"), bar=rooms.NoBar)
        embed = stages.bind("embed", {"encoder": "minilm", "threads": 1, "normalize": normalize})
        job = jobs.job(work, embed, "rooms", upstream=f"captions/{style}")
        runs.run(job, bar=rooms.NoBar)
    # Features of another length are not what the head was trained on.
    assert list(other_captions(work, head, source)) == ["captions counts"]


def test_captions_that_were_imported_cannot_be_changed(work, monkeypatch):
    table = work.table("rooms", "captions/occupancy")
    about = replace(table.description(), inputs=["samples"])
    kind = type(table)
    real = kind.description
    monkeypatch.setattr(
        kind,
        "description",
        lambda self: about if self.name == "captions/occupancy" else real(self),
    )
    with pytest.raises(RsaDataError, match="written from segments"):
        robustness(work)
