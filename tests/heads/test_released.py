"""Checkpoints in the form of the released ones, made here: train_lanscale.py writes such a dict."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from rsa_data.common.errors import RsaDataError
from rsa_data.heads.checkpoint import ScaleHead

# Widths of lanscale.py's three networks at the release's 1024 numbers of CLIP RN50.
SHARED, BRANCH = (1024, 512, 256, 256), (256, 128, 64, 1)


def networks() -> dict[str, torch.nn.Sequential]:
    torch.manual_seed(0)
    made = {}
    for name, sizes in (("scene_feat_net", SHARED), ("shift_net", BRANCH), ("scale_net", BRANCH)):
        layers = []
        for size, after in pairwise(sizes):
            layers += [torch.nn.Linear(size, after), torch.nn.LeakyReLU()]
        made[name] = torch.nn.Sequential(*layers[:-1])
    return made


def checkpoint(path, **more):
    parts = networks()
    model = {
        f"module.{n}.{k}": v for n, part in parts.items() for k, v in part.state_dict().items()
    }
    torch.save({"model": model, **more}, path)
    return path


def test_what_a_file_says_of_itself_is_kept(tmp_path):
    nine = torch.arange(1, 10) / 8
    more = {
        "global_step": 123,
        "lr": 1e-4,
        "best_eval_measures_nyu": nine,
        "best_eval_steps": torch.zeros(9),
        "best_eval_measures_kitti": nine * 2,
    }
    head = ScaleHead.load(checkpoint(tmp_path / "a.pt", **more))
    x = torch.randn(5, 1024)
    parts = networks()
    seen = parts["scene_feat_net"](x)
    with torch.no_grad():
        for found, name in zip(head.outputs(x.numpy()), ("scale_net", "shift_net"), strict=True):
            np.testing.assert_allclose(found, parts[name](seen)[:, 0].exp(), rtol=1e-5)
    said = head.description
    assert said["architecture"] == {"name": "mlp3"} and said["standardized"] is False
    assert said["parameters"] == sum(p.numel() for n in parts.values() for p in n.parameters())
    assert said["imported"]["file"] == "a.pt" and said["imported"]["steps"] == 123
    measures = said["imported"]["measures"]
    assert set(measures) == {"nyu", "kitti"}
    assert list(measures["nyu"].values()) == nine.tolist()
    assert list(measures["kitti"].values()) == (nine * 2).tolist()


@pytest.mark.parametrize("steps", [-1, 2**53, 1.5, "7", None])
def test_steps_that_are_no_count_are_left_open(tmp_path, steps):
    head = ScaleHead.load(checkpoint(tmp_path / "a.pt", global_step=steps))
    assert (head.description.get("imported") or {}).get("steps") is None


def test_a_foreign_name_is_quoted_in_part(tmp_path):
    torch.save({"model": {"x" * 500: [1]}}, tmp_path / "a.pt")
    with pytest.raises(RsaDataError, match=f"found '{'x' * 40}': list$"):
        ScaleHead.load(tmp_path / "a.pt")


def test_measures_that_are_not_nine_numbers_are_refused(tmp_path):
    for wrong in (torch.zeros(8), torch.tensor([float("nan")] * 9)):
        path = checkpoint(tmp_path / "a.pt", best_eval_measures_nyu=wrong)
        with pytest.raises(RsaDataError, match="expected 9 finite numbers"):
            ScaleHead.load(path)
