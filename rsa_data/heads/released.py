"""Heads that the authors of RSA released as PyTorch checkpoints, and import-head."""

import pickle
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..common.errors import RsaDataError
from ..store.tables import WorkDir

if TYPE_CHECKING:
    from .checkpoint import ScaleHead

# Order of the nine numbers in the checkpoints' best_eval_measures_* (released train_3d.py).
_MEASURES = [
    "silog",
    "abs_rel",
    "log10",
    "rmse",
    "sq_rel",
    "rmse_log",
    "delta1",
    "delta2",
    "delta3",
]
_PREFIX = "best_eval_measures_"


def read_released(path: Path) -> "ScaleHead":
    """The head of a released checkpoint: mlp3 or mlp5, on raw features of CLIP RN50.

    The file is read as plain tensors (`weights_only`): no code in it can run. What its features
    and relative depth were made of is not in the file, so it is left open in the description.
    Raises RsaDataError when the file is not such a checkpoint.
    """
    import torch

    from .checkpoint import FORMAT, ScaleHead

    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError as error:
        raise RsaDataError(f"{path}: expected a released head (.pt); found no such file") from error
    except (pickle.UnpicklingError, RuntimeError, EOFError, OSError) as error:
        raise RsaDataError(
            f"{path}: expected a released head, a PyTorch file of plain tensors; found another "
            "kind of file, or a broken one"
        ) from error
    weights = content.get("model") if isinstance(content, dict) else None
    if not isinstance(weights, dict) or not weights:
        raise RsaDataError(f"{path}: expected a checkpoint with the entry 'model'; found none")
    # Training on several GPUs leaves a prefix.
    weights = {name.removeprefix("module."): tensor.float() for name, tensor in weights.items()}
    first = weights.get("scene_feat_net.0.weight")
    if first is None or first.ndim != 2:
        raise RsaDataError(
            f"{path}: expected weights such as scene_feat_net.0.weight; found {', '.join(weights)}"
        )
    dim = first.shape[1]
    description: dict[str, Any] = {
        "format": FORMAT,
        "architecture": {"name": "mlp5" if "scene_feat_net.8.weight" in weights else "mlp3"},
        "parameters": sum(tensor.numel() for tensor in weights.values()),
        "features": {
            "dim": dim,
            "style": None,
            "encoder": "clip-rn50",
            "options": {"encoder": "clip-rn50", "normalize": False},
            "files": None,
            "stage_version": None,
        },
        "standardized": False,
        "depth_model": {
            "model": None,
            "options": None,
            "files": None,
            "stage_version": None,
            "geometry": {},
        },
        "imported": {
            "file": path.name,
            "steps": content.get("global_step"),
            # float32 in the file: 7 digits are all that they hold.
            "measures": {
                name.removeprefix(_PREFIX): {
                    key: float(f"{value:.7g}")
                    for key, value in zip(_MEASURES, tensor.tolist(), strict=True)
                }
                for name, tensor in content.items()
                if name.startswith(_PREFIX)
            },
        },
    }
    tensors = {"mean": torch.zeros(dim), "factor": torch.ones(dim), **weights}
    try:
        return ScaleHead.from_tensors(tensors, description)
    except RsaDataError as error:
        raise RsaDataError(f"{path}: {error}") from error


def import_head(
    work: WorkDir, file: Path, *, name: str | None = None
) -> tuple[str, dict[str, Any]]:
    """Reads a released checkpoint and writes it as a head of a work dir.

    Parameters
    ----------
    name : folder of the head below WORK/heads; the file's name without its ending by default.

    Returns that folder and the head's description. A head that is there already is left as it is.
    """
    head = read_released(file)
    folder = f"heads/{name or file.stem}"
    if work.store.size(f"{folder}/head.json") is not None:
        raise RsaDataError(
            f"{work.store.location}/{folder}: there is a head of this name already; it was left "
            "as it is. Give another --name"
        )
    head.save(work.store, folder)
    return f"{work.store.location}/{folder}", head.description
