"""Weights from files that others wrote: safetensors, .pt state dicts, TorchScript archives.

Nothing here runs code from a file. Safetensors hold no code. A state dict is unpickled with
`weights_only=True`. A TorchScript archive (OpenAI's CLIP files) is a zip of a pickle, raw tensors
and source code; `torch.jit.load` would compile that source, so only the pickle is read here, by an
unpickler that knows how to make tensors and refuses every other callable.
"""

import math
import pickle
import warnings
import zipfile
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from ..common.errors import RsaDataError

if TYPE_CHECKING:
    import torch

# Names of torch's typed storages in pickles, and the dtype of each.
_STORAGES = {
    "FloatStorage": "float32",
    "HalfStorage": "float16",
    "BFloat16Storage": "bfloat16",
    "DoubleStorage": "float64",
    "LongStorage": "int64",
    "IntStorage": "int32",
    "BoolStorage": "bool",
}


_COUNTER = "num_batches_tracked"


def read_tensors(path: Path) -> "dict[str, torch.Tensor]":
    """All tensors of a checkpoint by name, as stored (their dtype is not changed).

    The kind of file is told from its bytes, not from its name. Raises RsaDataError when the file
    is missing, damaged, or holds more than tensors.
    """
    try:
        with path.open("rb") as file:
            start = file.read(9)
    except OSError as error:
        raise RsaDataError(
            f"{path}: expected a checkpoint; it cannot be read: {error.strerror}"
        ) from error
    try:
        if start[:2] == b"PK":
            with zipfile.ZipFile(path) as archive:
                names = archive.namelist()
            scripted = any(name.endswith("/constants.pkl") for name in names)
            return _read_torchscript(path) if scripted else _read_state_dict(path)
        if start[8:] == b"{":
            from safetensors.torch import load_file

            return load_file(path)
        return _read_state_dict(path)
    except (RsaDataError, MemoryError):
        raise
    # The readers raise errors of many kinds on damaged files (struct, zip, pickle, runtime).
    except Exception as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise RsaDataError(
            f"{path}: expected a safetensors file, a .pt state dict or a TorchScript archive; "
            f"reading it failed: {reason}. Is the download complete?"
        ) from error


def _read_state_dict(path: Path) -> "dict[str, torch.Tensor]":
    import torch

    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise RsaDataError(
            f"{path}: expected a .pt file that holds tensors only; loading it safely was refused, "
            "because it is damaged, no checkpoint, or a pickle that would run code. "
            "Use a safetensors file instead."
        ) from error
    # open_clip's training checkpoints wrap the state dict and prefix each name.
    if isinstance(content, dict) and isinstance(content.get("state_dict"), dict):
        content = content["state_dict"]
    if not isinstance(content, dict) or not content:
        raise RsaDataError(f"{path}: expected a state dict, found {type(content).__name__}")
    if strange := [k for k, v in content.items() if not isinstance(v, torch.Tensor)]:
        raise RsaDataError(f"{path}: expected a state dict of tensors; {strange[0]!r} is no tensor")
    return {str(name).removeprefix("module."): tensor for name, tensor in content.items()}


def _read_torchscript(path: Path) -> "dict[str, torch.Tensor]":
    with zipfile.ZipFile(path) as archive:
        (data,) = [n for n in archive.namelist() if n.count("/") == 1 and n.endswith("/data.pkl")]
        with archive.open(data) as file:
            root = _TensorUnpickler(file, archive, data.removesuffix(".pkl")).load()
    found: dict[str, torch.Tensor] = {}
    _collect(root, "", found)
    return found


class _ScriptModule:
    """Stands for any class of the archive: it only receives the attributes."""


class _TensorUnpickler(pickle.Unpickler):
    """Unpickles tensors and containers; names of the archive's own classes become _ScriptModule."""

    def __init__(self, file: IO[bytes], archive: zipfile.ZipFile, folder: str):
        super().__init__(file)
        self.archive, self.folder = archive, folder

    def find_class(self, module: str, name: str) -> Any:
        if module.startswith("__torch__"):
            return _ScriptModule
        if module == "torch" and name in _STORAGES:
            return _STORAGES[name]
        if (module, name) == ("collections", "OrderedDict"):
            return dict
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return _rebuild_tensor
        if module == "torch.jit._pickle":
            return lambda value, *_: value
        raise RsaDataError(
            f"{self.archive.filename}: expected tensors only; found {module}.{name}, which would "
            "run code: refused. Use a safetensors file instead."
        )

    def persistent_load(self, key: Any) -> "torch.Tensor":
        import torch

        _, dtype, name, _, _ = key
        with warnings.catch_warnings():
            # The bytes are read-only and nobody writes to them.
            warnings.filterwarnings("ignore", "The given buffer is not writable")
            data = self.archive.read(f"{self.folder}/{name}")
            return torch.frombuffer(data, dtype=getattr(torch, dtype))


def _rebuild_tensor(
    storage: "torch.Tensor", offset: int, size: tuple[int, ...], stride: tuple[int, ...], *_: Any
) -> "torch.Tensor":
    return storage.as_strided(size, stride, offset)


def _collect(module: Any, prefix: str, found: dict[str, Any]) -> None:
    import torch

    for name, value in vars(module).items():
        if isinstance(value, torch.Tensor):
            found[prefix + name] = value
        elif isinstance(value, _ScriptModule):
            _collect(value, f"{prefix}{name}.", found)


def load_strictly(
    module: "torch.nn.Module", tensors: "dict[str, torch.Tensor]", path: Path
) -> None:
    """Copies `tensors` into `module` as float32: every name and shape must be the module's own.

    Raises RsaDataError on missing or unknown names, other shapes, and values that are not finite.
    """
    import torch

    # BatchNorm counts its training batches; nothing reads that, and some files lack it.
    want = {n: t for n, t in module.state_dict().items() if not n.endswith(_COUNTER)}
    tensors = {n: t for n, t in tensors.items() if not n.endswith(_COUNTER)}
    if missing := sorted(set(want) - set(tensors)):
        raise RsaDataError(
            f"{path}: another architecture: expected the tensor {missing[0]!r}"
            f"{f' and {len(missing) - 1} more' if len(missing) > 1 else ''}; not found"
        )
    if strange := sorted(set(tensors) - set(want)):
        raise RsaDataError(
            f"{path}: another architecture: found the tensor {strange[0]!r}"
            f"{f' and {len(strange) - 1} more' if len(strange) > 1 else ''}; not expected"
        )
    with torch.no_grad():
        for name, parameter in want.items():
            tensor = tensors[name]
            if tensor.shape != parameter.shape:
                raise RsaDataError(
                    f"{path}: another architecture: {name} has shape {tuple(tensor.shape)}; "
                    f"expected {tuple(parameter.shape)}"
                )
            # A sum is finite only where all of its terms are, and is ten times as fast to look at.
            if not (math.isfinite(tensor.sum().item()) or torch.isfinite(tensor).all()):
                raise RsaDataError(f"{path}: damaged: {name} holds values that are not finite")
            parameter.copy_(tensor)
