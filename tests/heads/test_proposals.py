"""Detector features: laid side by side by a stage, pooled by the head."""

from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
import torch

from rsa_data import ScaleHead
from rsa_data.common.errors import RowError, RsaDataError
from rsa_data.embeddings.proposals import build
from rsa_data.heads.architectures.proposals import Proposals
from rsa_data.segments.segments import Segments, to_table
from rsa_data.store import schemas


def seen(score: list[float], features: np.ndarray | None) -> Segments:
    n = len(score)
    return Segments(
        label=["chair"] * n,
        area=np.full(n, 0.1),
        score=np.array(score, np.float32),
        is_thing=np.ones(n, bool),
        box=None,
        width=8,
        height=8,
        feature=features,
    )


def test_the_surest_objects_stand_first_and_nothing_is_zero():
    features = np.arange(9, dtype=np.float32).reshape(3, 3) + 1
    found = [seen([0.2, 0.9, 0.5], features), RowError("a.png: broken"), seen([], features[:0])]
    out = build(most=2, store="float32")(to_table(["a", "b", "c"], found), pa.table({}))
    schemas.check("image_embeddings", out)
    assert out["status"].to_pylist() == ["ok", "failed", "ok"]
    rows = [None if b is None else np.frombuffer(b, "<f4") for b in out["embedding"].to_pylist()]
    np.testing.assert_array_equal(rows[0], [4, 5, 6, 1, 7, 8, 9, 1])
    assert rows[1] is None
    np.testing.assert_array_equal(rows[2], np.zeros(8))


def test_segments_without_features_are_refused():
    with pytest.raises(RsaDataError, match="expected the detector's features beside its segments"):
        build()(to_table(["a"], [seen([0.5], None)]), pa.table({}))


def test_the_pool_is_the_mean_over_the_objects_that_are_there():
    torch.manual_seed(0)
    network = Proposals(5 * 4, 3)
    objects = torch.randn(2, 3)
    row = torch.zeros(1, 5, 4)
    row[0, :2, :3], row[0, :2, 3] = objects, 1
    pooled = network.object_net(network.norm(objects)).mean(0, keepdim=True)
    expected = network.scale_net(pooled).exp()[:, 0], network.shift_net(pooled).exp()[:, 0]
    torch.testing.assert_close(network(row.flatten(1)), expected)
    # Order does not matter, nor does an image without objects break it.
    torch.testing.assert_close(network(row[:, [3, 1, 4, 0, 2]].flatten(1)), expected)
    scale, shift = network(torch.zeros(1, 20))
    assert scale.isfinite().all() and shift.isfinite().all()


def test_the_size_of_a_feature_follows_from_its_table():
    """20 numbers of 5 objects: 3 of each, and the 1 that says that it is there."""
    table = SimpleNamespace(width=20, objects=5)
    sizes = Proposals.sizes([table])
    assert Proposals(20, **sizes).width == 4 and sizes == {"feature_dim": 3}


def test_a_head_of_proposals_is_saved_with_what_it_needs(tmp_path):
    from rsa_data.heads.checkpoint import build_network
    from rsa_data.store.tables import WorkDir

    about = {"format": 1, "architecture": {"name": "proposals", "feature_dim": 3}}
    about["features"] = {"dim": 20}
    network = build_network(about["architecture"], 20)
    ScaleHead(network, about, torch.zeros(20), torch.ones(20)).save(
        WorkDir(tmp_path).store, "heads/p"
    )
    x = np.ones((2, 20), np.float32)
    np.testing.assert_array_equal(
        ScaleHead.load(tmp_path / "heads/p")(x)[0], network(torch.from_numpy(x))[0].numpy()
    )
