"""Heads that the authors of RSA released as PyTorch checkpoints: reading one, code excluded."""

import pickle
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..common import bounded
from ..common.errors import RsaDataError
from .description import FORMAT, MAX_BYTES, DepthModel, Description, Features, Imported

if TYPE_CHECKING:
    import torch

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
# What the released heads read.
ENCODER = "clip-rn50"
# Numbers of a text feature of CLIP RN50, which all released heads read.
_DIM = 1024
_PREFIX = "best_eval_measures_"


def read_released(path: Path) -> "tuple[dict[str, torch.Tensor], Description]":
    """What a released checkpoint holds: an mlp3 or mlp5 on raw features of CLIP RN50.

    Returns the tensors as `ScaleHead.from_tensors` takes them, float32, and their description.

    The file is recognised by its content and read as plain tensors (`weights_only`): no code in it
    can run. What its features and relative depth were made of is not in the file, so it is left
    open in the description. Raises RsaDataError when the file is not such a checkpoint.
    """
    content = _read(path)
    weights = _weights(path, content.get("model"))
    first = weights.get("scene_feat_net.0.weight")
    if first is None or first.ndim != 2:
        raise RsaDataError(
            f"{path}: expected weights such as scene_feat_net.0.weight; found "
            f"{', '.join(list(weights)[:8])}"
        )
    import torch

    dim = first.shape[1]
    if dim != _DIM:
        raise RsaDataError(
            f"{path}: expected weights for the {_DIM:,} numbers of a feature of CLIP RN50; found "
            f"scene_feat_net.0.weight for {dim:,}"
        )
    description = Description(
        format=FORMAT,
        architecture={"name": "mlp5" if "scene_feat_net.8.weight" in weights else "mlp3"},
        parameters=sum(tensor.numel() for tensor in weights.values()),
        features=Features(
            dim=dim,
            encoder=ENCODER,
            options={"encoder": ENCODER, "normalize": False},
        ),
        standardized=False,
        depth_model=DepthModel(),
        imported=Imported(file=path.name, steps=_steps(content), measures=_measures(path, content)),
    )
    return {"mean": torch.zeros(dim), "factor": torch.ones(dim), **weights}, description


def _read(path: Path) -> dict[str, Any]:
    import torch

    other = RsaDataError(
        f"{path}: expected a released head, a PyTorch file of plain tensors; found another kind of "
        "file, or a broken one"
    )
    try:
        bounded.check_file(path)  # a pipe would be waited for
        if (size := path.stat().st_size) > MAX_BYTES:
            raise RsaDataError(
                f"{path}: expected a released head of at most {MAX_BYTES:,} bytes; found {size:,}"
            )
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                # PyTorch stores plainly; a deflated entry could unfold to any size.
                if any(entry.compress_type != zipfile.ZIP_STORED for entry in archive.infolist()):
                    raise other
        content = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError as error:
        raise RsaDataError(f"{path}: expected a released head; found no such file") from error
    except RsaDataError:
        raise
    except (
        pickle.UnpicklingError, zipfile.BadZipFile, RuntimeError, EOFError, OSError, ValueError,
        TypeError, KeyError, AttributeError, IndexError, AssertionError, OverflowError,
        UnicodeDecodeError, NotImplementedError, MemoryError,
    ) as error:  # fmt: skip
        raise other from error
    if not isinstance(content, dict):
        raise RsaDataError(f"{path}: expected a checkpoint with the entry 'model'; found none")
    return content


def _weights(path: Path, found: Any) -> "dict[str, torch.Tensor]":
    """The tensors of the head, float32, by the names of its architecture."""
    import torch

    if not isinstance(found, dict) or not found:
        raise RsaDataError(f"{path}: expected a checkpoint with the entry 'model'; found none")
    weights = {}
    for name, tensor in found.items():
        plain = isinstance(tensor, torch.Tensor) and tensor.layout == torch.strided
        if not isinstance(name, str) or not plain or not tensor.is_floating_point():
            raise RsaDataError(
                f"{path}: expected model to hold tensors of floating point numbers; found "
                f"{str(name)[:40]!r}: {type(tensor).__name__}"
            )
        # A view can claim more numbers than the file holds.
        if tensor.numel() * tensor.element_size() > tensor.untyped_storage().nbytes():
            raise RsaDataError(f"{path}: model.{name[:40]}: expected a tensor that the file holds")
        # Training on several GPUs leaves a prefix.
        weights[name.removeprefix("module.")] = tensor.float().contiguous()
    return weights


def _steps(content: dict[str, Any]) -> int | None:
    steps = content.get("global_step")
    return steps if isinstance(steps, int) and 0 <= steps < 2**53 else None


def _measures(path: Path, content: dict[str, Any]) -> dict[str, dict[str, float]]:
    """The nine numbers that the file says of itself, by dataset."""
    import torch

    measures = {}
    for name, tensor in content.items():
        if not isinstance(name, str) or not name.startswith(_PREFIX):
            continue
        good = isinstance(tensor, torch.Tensor) and tuple(tensor.shape) == (len(_MEASURES),)
        if not good or not tensor.float().isfinite().all():
            raise RsaDataError(f"{path}: {name[:60]}: expected {len(_MEASURES)} finite numbers")
        # float32 in the file: 7 digits are all that they hold.
        numbers = [float(f"{value:.7g}") for value in tensor.tolist()]
        measures[name.removeprefix(_PREFIX)] = dict(zip(_MEASURES, numbers, strict=True))
    return measures
