"""The description of a head, after somebody edited it."""

from pathlib import Path
from typing import Any

import numpy as np
import torch

from rsa_data.common import tokenizers
from rsa_data.common.errors import RsaDataError
from rsa_data.heads import checkpoint
from rsa_data.heads.predict import predict
from rsa_data.runner import status
from rsa_data.store.tables import WorkDir

from .forms import Importer, One, js


def stand_in(here: Path, dim: int = 8) -> tuple[WorkDir, dict[str, Any]]:
    """A head of 8 features that is not trained."""
    about: dict[str, Any] = {
        "format": 1,
        "architecture": {"name": "linear"},
        "features": {"dim": dim, "encoder": "minilm", "style": "occupancy", "files": {},
                     "options": {"encoder": "minilm", "normalize": False}},
        "depth_model": {"model": "files", "options": None, "files": {}, "geometry": {"a": {}}},
        "far": 0.5, "prior": {"scale": 0.3, "shift": 0.3, "correlation": 0.1},
        "datasets": {"rooms": {"tables": {"samples": "0" * 64}}},
        "captions": {"rooms": {"style": "occupancy"}}, "segments": {"rooms": "segments/labels"},
    }  # fmt: skip
    network = checkpoint.build_network(about["architecture"], dim)
    reference = np.eye(dim, dtype=np.float16)
    head = checkpoint.ScaleHead(network, about, torch.zeros(dim), torch.ones(dim), reference)
    work = WorkDir(here / "work")
    head.save(work.store, "heads/head")
    return work, about


def features_of(texts: list[str], dim: int = 8) -> np.ndarray:
    """Features that depend on the tokens alone, by the real tokenizers."""
    ids = tokenizers.clip().ids(texts)
    assert (tokenizers.clip().count(texts) <= [2 * len(text.encode()) + 2 for text in texts]).all()
    return np.stack([np.bincount(np.array(row) % dim, minlength=dim) for row in ids]) / 10.0


def head_seeds() -> list[bytes]:
    import tempfile

    with tempfile.TemporaryDirectory() as place:
        about = stand_in(Path(place))[1]
    return [js(about), js({**about, "architecture": {"name": "mlp3"}})]


def head(here: Path) -> One:
    work, _ = stand_in(here)
    place = Path(work.store.location) / "heads" / "head"

    def one(data: bytes) -> None:
        (place / "head.json").write_bytes(data)
        for act in (
            lambda: status.status(work),
            lambda: predict.from_captions(
                checkpoint.ScaleHead.load(str(place)), ["a bed with a lamp"], encoder=features_of
            ),
        ):
            try:
                act()
            except RsaDataError:
                continue

    return one


IMPORTERS = {
    "head": Importer(head_seeds, head),
}
