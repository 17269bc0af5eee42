"""Running a network over batches: in torch on a CPU or GPU, or in ONNX Runtime on a CPU."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

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
        tensors = {name: torch.from_numpy(value) for name, value in inputs.items()}
        if device == "cuda":
            # Pinned memory lets the copy run beside the computation.
            tensors = {n: t.pin_memory().to(device, non_blocking=True) for n, t in tensors.items()}
        features: torch.Tensor = module(**tensors)
        return features

    def run(batches: Iterable[Batch]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        waiting: tuple[np.ndarray, torch.Tensor] | None = None
        for rows, inputs in batches:
            features = forward(inputs)
            if waiting:
                yield waiting[0], waiting[1].float().cpu().numpy()
            waiting = rows, features
        if waiting:
            yield waiting[0], waiting[1].float().cpu().numpy()

    return run


def in_onnx(graph: Path, threads: int) -> Run:
    """A graph whose inputs have the names of a batch's, in ONNX Runtime on the CPU."""
    from ..common.onnx_sessions import open_session

    session: Any = open_session(graph, threads, "cpu")

    def run(batches: Iterable[Batch]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for rows, inputs in batches:
            yield rows, session.run(None, inputs)[0]

    return run
