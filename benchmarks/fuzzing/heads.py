"""The description of a head, after somebody edited it."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import load_file, save_file

from rsa_data.common import tokenizers
from rsa_data.common.errors import RsaDataError
from rsa_data.heads import checkpoint, travel
from rsa_data.heads.checkpoint import ScaleHead
from rsa_data.heads.predict import from_captions
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
            lambda: from_captions.from_captions(
                checkpoint.ScaleHead.load(str(place)), ["a bed with a lamp"], encoder=features_of
            ),
        ):
            try:
                act()
            except RsaDataError:
                continue

    return one


def checkpoint_seeds() -> list[bytes]:
    """Shapes of a released checkpoint's tensors, as JSON: [name, shape, dtype, value]."""
    nets = {"scene_feat_net": (1024, 512, 256, 256), "shift_net": (256, 128, 64, 1),
            "scale_net": (256, 128, 64, 1)}  # fmt: skip
    shared: list[list[Any]] = []
    for net, sizes in nets.items():
        for n, (before, after) in enumerate(pairwise(sizes)):
            shared.append([f"module.{net}.{2 * n}.weight", [after, before], "float32", 0.01])
            shared.append([f"module.{net}.{2 * n}.bias", [after], "float32", 0])
    measures = [["nyu", [9], "float32", 0.5]]
    about = {"model": shared, "measures": measures, "global_step": 3}
    return [js(about), js({**about, "measures": []}), js({"model": []})]


def released_checkpoint(here: Path) -> One:
    """import-head on .pt files whose names, shapes and kinds of tensors are anything."""

    def tensor(shape: Any, kind: Any, value: Any) -> Any:
        try:
            whole = [int(side) for side in shape][:4]
            if np.prod([float(side) for side in whole]) > 1e6:
                return torch.zeros(1).expand(whole)
            return torch.full(whole, value, dtype=getattr(torch, str(kind)))
        except (TypeError, ValueError, RuntimeError, AttributeError, OverflowError):
            return value

    def rows(value: Any) -> list[list[Any]]:
        return [row for row in value if isinstance(row, list) and len(row) == 4]

    def one(data: bytes) -> None:
        try:
            about = json.loads(data)
            content = {"model": {str(n): tensor(*rest) for n, *rest in rows(about["model"])}}
            for name, *rest in rows(about["measures"]):
                content[f"best_eval_measures_{name}"] = tensor(*rest)
            content["global_step"] = about["global_step"]
            torch.save(content, here / "head.pt")
        except (ValueError, KeyError, TypeError, RuntimeError, RecursionError, UnicodeError):
            (here / "head.pt").write_bytes(data)
        if (here / "head.pt").stat().st_size < 1 << 22:
            ScaleHead.load(here / "head.pt")

    return one


def exported(here: Path) -> One:
    """A file of export-head whose metadata says anything of the head."""
    work, _ = stand_in(here)
    travel.export_head(work, "head", here / "good.safetensors")
    tensors = load_file(here / "good.safetensors")
    made = here / "head.safetensors"

    def one(data: bytes) -> None:
        try:
            save_file(tensors, made, {"head.json": data.decode()})
        except UnicodeDecodeError:
            made.write_bytes(data)
        head = travel.from_file(made)
        assert np.isfinite(head(np.ones((2, head.dim), np.float32))).all()

    return one


IMPORTERS = {
    "exported-head": Importer(head_seeds, exported),
    "head": Importer(head_seeds, head),
    "import-head": Importer(checkpoint_seeds, released_checkpoint),
}
