"""An untrained head, and a map for it."""

import numpy as np
import pytest
import torch

from rsa_data.heads.checkpoint import ScaleHead, build_network
from rsa_data.store.tables import WorkDir


@pytest.fixture
def work(tmp_path) -> WorkDir:
    """A head for minilm, untrained."""
    work = WorkDir(tmp_path / "work")
    features = {"dim": 384, "encoder": "minilm", "files": None}
    features["options"] = {"encoder": "minilm", "normalize": False}
    model = {"model": "files", "options": None, "files": {}, "geometry": {"rooms": {}}}
    about = {"format": 1, "architecture": {"name": "linear"}, "features": features}
    torch.manual_seed(0)
    head = ScaleHead(
        build_network(about["architecture"], 384),
        {**about, "depth_model": model, "far": 0.5},
        torch.zeros(384),
        torch.ones(384),
        np.ones((1, 384), np.float16),
    )
    head.save(work.store, "heads/head")
    return work


@pytest.fixture
def y(tmp_path) -> np.ndarray:
    y = np.random.default_rng(0).uniform(0.5, 4, (6, 8)).astype(np.float32)
    np.save(tmp_path / "y.npy", y)
    return y
