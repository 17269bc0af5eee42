"""Heads on disk and in use: architectures, released checkpoints, metric depth."""

import json
import os
import re

import numpy as np
import pytest
import torch

import rsa_data
from rsa_data import ScaleHead, to_metric
from rsa_data.common.errors import RsaDataError
from rsa_data.heads.checkpoint import build_network
from rsa_data.heads.import_head import import_head
from rsa_data.registry import HEADS
from rsa_data.store.tables import WorkDir

OWN = {"fusion": {"text_dim": 24}, "proposals": {"feature_dim": 7}}
OWN |= {name: {"object_dim": 32} for name in HEADS if "object" in name}


def head_of(dim: int = 8, name: str = "linear", mean: float = 0.0, factor: float = 1.0):
    architecture = {"name": name, **OWN.get(name, {})}
    description = {"format": 1, "architecture": architecture, "features": {"dim": dim}}
    torch.manual_seed(0)
    network = build_network(description["architecture"], dim)
    full = torch.full((dim,), 1.0)
    return ScaleHead(network, description, mean * full, factor * full)


@pytest.fixture
def saved(tmp_path):
    head_of(name="mlp3").save(WorkDir(tmp_path).store, "heads/x")
    return tmp_path / "heads" / "x"


@pytest.mark.parametrize(
    ("name", "parameters"), [("mlp5", 1_494_274), ("mlp3", 804_354), ("linear", 2050)]
)
def test_parameters_at_1024_inputs(name, parameters):
    network = build_network({"name": name}, 1024)
    assert sum(p.numel() for p in network.parameters()) == parameters


@pytest.mark.parametrize("name", HEADS)
def test_every_head_gives_positive_scale_and_shift(name):
    scale, shift = head_of(64, name)(np.random.default_rng(0).normal(size=(5, 64)))
    assert scale.shape == shift.shape == (5,)
    assert (scale > 0).all() and (shift > 0).all()


@pytest.mark.parametrize("name", ["mlp3", "fusion", "transformer", "proposals"])
def test_the_ends_of_the_papers_heads_are_three_layers(name):
    """256, 128, 64, 1, as lanscale.py of the release; the rebuttal calls the others' 3-layer."""
    network = build_network({"name": name, **OWN.get(name, {})}, 64)
    for net in (network.shift_net, network.scale_net):
        sizes = [(m.in_features, m.out_features) for m in net if isinstance(m, torch.nn.Linear)]
        assert sizes == [(256, 128), (128, 64), (64, 1)]


def test_weights_of_another_kind_say_what_they_are(saved):
    head = ScaleHead.load(saved)
    tensors = {"mean": head.mean, "factor": head.factor, **head.network.state_dict()}
    key = next(key for key, tensor in tensors.items() if tensor.ndim == 2)
    tensors[key] = tensors[key].double()
    shape = tuple(tensors[key].shape)
    says = f"{key} as float32 {shape}; found float64 {shape}"
    with pytest.raises(RsaDataError, match=re.escape(says)):
        ScaleHead.from_tensors(tensors, head.about)


def test_queries_begin_as_tokens_of_a_transformer_do():
    """Devlin et al. 2019, and ViT: learned tokens begin with a standard deviation of 0.02."""
    torch.manual_seed(0)
    queries = build_network({"name": "transformer"}, 64).queries.detach()
    assert queries.std().item() == pytest.approx(0.02, rel=0.1) and abs(queries.mean()) < 0.003


def test_numpy_in_numpy_out_torch_in_torch_out():
    features = np.random.default_rng(0).normal(size=(3, 8)).astype(np.float16)
    arrays = head_of()(features)
    tensors = head_of()(torch.from_numpy(features))
    for array, tensor in zip(arrays, tensors, strict=True):
        assert isinstance(array, np.ndarray) and array.dtype == np.float32
        assert isinstance(tensor, torch.Tensor)
        np.testing.assert_array_equal(array, tensor.numpy())


def test_the_head_takes_raw_features_and_standardises_them_itself():
    x = np.random.default_rng(0).normal(size=(4, 8)).astype(np.float32)
    plain = head_of()((x - 3) * 0.5)
    np.testing.assert_allclose(head_of(mean=3, factor=0.5)(x), plain, rtol=1e-6)


def test_no_features_give_no_scales():
    scale, shift = head_of()(np.empty((0, 8), np.float32))
    assert scale.shape == shift.shape == (0,)


@pytest.mark.parametrize(
    ("features", "message"),
    [
        (np.zeros((2, 9), np.float32), r"expected shape \(n, 8\).*found \(2, 9\)"),
        (np.zeros(8, np.float32), r"expected shape \(n, 8\).*found \(8,\)"),
        (np.zeros((2, 8), np.int64), "expected float16, float32 or float64; found int64"),
        (np.array([[0.0] * 8, [np.nan] * 8]), "nan or inf in 1 rows of 2, the first is row 1"),
        (np.full((1, 8), np.inf), "nan or inf"),
    ],
    ids=["dim", "1-d", "dtype", "nan", "inf"],
)
def test_features_that_do_not_fit_are_refused(features, message):
    with pytest.raises(RsaDataError, match=message):
        head_of()(features)


def test_saved_and_loaded_is_the_same_head(saved):
    x = np.random.default_rng(0).normal(size=(4, 8))
    np.testing.assert_array_equal(ScaleHead.load(saved)(x), head_of(name="mlp3")(x))


def edit(path, **changes):
    about = json.loads(path.read_text())
    del about["digest"]  # which says so before anything else
    path.write_text(json.dumps(about | changes))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda f: (f / "head.json").unlink(), "found no head.json"),
        (lambda f: (f / "head.json").write_text("{"), "does not describe a head"),
        (lambda f: edit(f / "head.json", format=9), "expected format 1; found 9"),
        (lambda f: edit(f / "head.json", architecture={"name": "mlp5"}), "weights of mlp5"),
        (lambda f: edit(f / "head.json", features={"dim": 9}), "weights of mlp3"),
        (lambda f: (f / "head.safetensors").unlink(), "broken or not of this head"),
        (lambda f: (f / "head.safetensors").write_bytes(b"x" * 99), "broken or not of this head"),
    ],
    ids=["no json", "bad json", "format", "architecture", "dim", "no weights", "bad weights"],
)
def test_a_broken_checkpoint_is_refused(saved, damage, message):
    damage(saved)
    with pytest.raises(RsaDataError, match=message):
        ScaleHead.load(saved)


@pytest.mark.parametrize("kind", [np.asarray, torch.as_tensor], ids=["numpy", "torch"])
def test_to_metric_is_one_over_scale_y_plus_shift(kind):
    y = kind([[0.0, 1.0], [4.0, -1.0]])
    depth = to_metric(y, 0.25, 0.25)
    np.testing.assert_allclose(depth, [[4.0, 2.0], [0.8, np.inf]])
    both = to_metric(kind([[0.0, 1.0], [0.0, 1.0]]), kind([1.0, 2.0]), kind([0.5, 0.25]))
    np.testing.assert_allclose(both, [[2, 1 / 1.5], [4, 1 / 2.25]], rtol=1e-6)


def test_to_metric_beyond_everything_is_inf_and_unknown_stays_unknown():
    depth = to_metric(np.array([-3.0, -1.0, np.nan]), 1.0, 1.0)
    np.testing.assert_array_equal(depth, [np.inf, np.inf, np.nan])


def test_public_names_resolve_and_others_do_not():
    for name in rsa_data.__all__:
        assert getattr(rsa_data, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        rsa_data.nothing  # noqa: B018


def forward_in_numpy(weights: dict[str, np.ndarray], x: np.ndarray) -> tuple[np.ndarray, ...]:
    """The released head, layer by layer in float64."""

    def run(name, h):
        for i in (0, 2, 4):
            h = h @ weights[f"{name}.{i}.weight"].T + weights[f"{name}.{i}.bias"]
            h = np.where(h < 0, 0.01 * h, h) if i < 4 else h
        return h

    z = run("scene_feat_net", x)
    return np.exp(run("scale_net", z)[:, 0]), np.exp(run("shift_net", z)[:, 0])


@pytest.mark.parametrize("file", ["da_lanscale.pt", "midas_lanscale.pt"])
def test_released_heads_equal_an_independent_forward_pass(shared, tmp_path, file):
    path = shared / "rsa_heads" / file
    features = np.load(shared / "clip_rn50/features.npy").astype(np.float32) * 10
    content = torch.load(path, map_location="cpu", weights_only=True)
    weights = {k: v.double().numpy() for k, v in content["model"].items()}
    expected = forward_in_numpy(weights, features.astype(np.float64))
    np.testing.assert_allclose(ScaleHead.load(path)(features), expected, rtol=1e-5)

    work = WorkDir(tmp_path)
    where, _ = import_head(work, path, name="released")
    again = ScaleHead.load(where)
    np.testing.assert_array_equal(again(features), ScaleHead.load(path)(features))
    assert again.description["architecture"] == {"name": "mlp3"}
    measures = again.description["imported"]["measures"]["nyu"]
    assert measures["abs_rel"] == pytest.approx(float(content["best_eval_measures_nyu"][1]), 1e-6)
    assert import_head(work, path, name="released")[0] == where  # the same once more
    (other,) = {"da_lanscale.pt", "midas_lanscale.pt"} - {file}
    with pytest.raises(RsaDataError, match="is a head of this name already"):
        import_head(work, path.with_name(other), name="released")


def test_the_released_depth_anything_head_knows_rooms_from_streets(shared):
    import pyarrow.parquet as pq

    features = np.load(shared / "clip_rn50/features.npy").astype(np.float32) * 10
    keys = pq.read_table(shared / "clip_rn50/captions.parquet")["key"].to_pylist()
    _, shift = ScaleHead.load(shared / "rsa_heads/da_lanscale.pt")(features)
    kitti = np.array([key.startswith("kitti") for key in keys])
    assert np.median(shift[kitti]) == pytest.approx(0.029, abs=0.001)
    assert np.median(shift[~kitti]) == pytest.approx(0.288, abs=0.002)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"not a checkpoint", "another kind of file, or a broken one"),
        ({"optimizer": 1}, "expected a checkpoint with the entry 'model'"),
        ({"model": {"a": torch.zeros(1)}}, "expected weights such as scene_feat_net.0.weight"),
        ({"model": {"scene_feat_net.0.weight": torch.zeros(4, 4)}}, "1,024 numbers of a feature"),
        ({"model": {"scene_feat_net.0.weight": torch.zeros(4, 1024)}}, "the weights of mlp3"),
    ],
    ids=["junk", "no model", "other model", "other features", "half a model"],
)
def test_files_that_are_not_released_heads_are_refused(tmp_path, content, message):
    path = tmp_path / "x.pt"
    path.write_bytes(content) if isinstance(content, bytes) else torch.save(content, path)
    with pytest.raises(RsaDataError, match=message):
        import_head(WorkDir(tmp_path), path)
    assert not (tmp_path / "heads").exists()


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "head.pt")
    with pytest.raises(RsaDataError, match="expected a released head"):
        ScaleHead.load(tmp_path / "head.pt")
