"""robustness: captions written anew from the same segments, with what is wrong in them."""

import numpy as np
import pytest
import rooms
from flat import evaluate, robustness, train_head
from made_tables import DEPTH
from msgspec.structs import replace

from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.evaluation.robustness import CHANGES, OBJECT_CHANGES
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
    assert "rooms: nothing found:" in robustness(work).summary


def test_a_control_does_not_read_descriptions(work):
    train_head(work, name="shuffled", control="shuffled", split_scene=True, **FAST)
    with pytest.raises(UsageError, match="control"):
        robustness(work, head="shuffled")


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
