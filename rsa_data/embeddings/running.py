"""Running a network over batches: in torch on a CPU or GPU, or in ONNX Runtime on a CPU."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..common.errors import RsaDataError
from .encoder import Batch

if TYPE_CHECKING:
    import torch

Precision = Literal["float32", "float16", "bfloat16", "int8"]

Run = Callable[[Iterable[Batch]], Iterator[tuple[np.ndarray, np.ndarray]]]
"""Batches -> (row numbers, features float32 of shape (b, dim)) of each, in order."""


def in_torch(module: "torch.nn.Module", precision: Precision, device: str) -> Run:
    """A module that takes the inputs of a batch by name, in torch.

    While a GPU computes one batch, the next one is made on the host.
    """
    import torch

    module = module.to(torch.device(device), getattr(torch, precision)).eval()
    if device == "cuda":
        # It compiles a plan for every new shape, and each batch has a shape of its own: 20 to 40 ms
        # a batch on an H100, more than the whole network takes.
        torch.backends.cuda.enable_cudnn_sdp(False)

    @torch.inference_mode()
    def forward(inputs: dict[str, np.ndarray]) -> torch.Tensor:
        """Features in float32, in memory of their own: a module may use its own again."""
        tensors = {name: torch.from_numpy(value) for name, value in inputs.items()}
        if device == "cuda":
            # Pinned memory lets the copy run beside the computation.
            tensors = {n: t.pin_memory().to(device, non_blocking=True) for n, t in tensors.items()}
        features: torch.Tensor = module(**tensors)
        if not isinstance(features, torch.Tensor) or not features.is_floating_point():
            found = getattr(features, "dtype", type(features).__name__)
            raise RsaDataError(f"the encoder: expected a tensor of real numbers, found {found}")
        return features.to(torch.float32, copy=True)

    def run(batches: Iterable[Batch]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        waiting: tuple[np.ndarray, torch.Tensor] | None = None
        for rows, inputs in batches:
            features = forward(inputs)
            if waiting:
                yield waiting[0], waiting[1].cpu().numpy()
            waiting = rows, features
        if waiting:
            yield waiting[0], waiting[1].cpu().numpy()

    return run


def in_onnx(graph: Path, threads: int) -> Run:
    """A graph whose inputs have the names of a batch's, in ONNX Runtime on the CPU."""
    from ..common.onnx_sessions import open_session

    session: Any = open_session(graph, threads, "cpu")

    def run(batches: Iterable[Batch]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for rows, inputs in batches:
            try:
                (features,) = session.run(None, inputs)
            # onnxruntime's errors have no common base but Exception.
            except Exception as error:
                reason = " ".join(str(error).split())[:300]
                raise RsaDataError(
                    f"the encoder's graph fails on a batch of {len(rows)}: {reason}. Use --runtime "
                    "torch"
                ) from error
            yield rows, features

    return run
