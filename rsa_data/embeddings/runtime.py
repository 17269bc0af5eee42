"""Running an encoder: torch on a CPU or GPU, or ONNX Runtime on a CPU."""

from collections.abc import Callable, Iterable, Iterator
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..common.digests import file_sha256
from ..common.errors import UsageError
from .encoder import Batch, TextModel

if TYPE_CHECKING:
    import torch

# A GPU wants larger batches than a CPU's cache does.
_GPU_FACTOR = 64

Precision = Literal["float32", "float16", "bfloat16", "int8"]
Runtime = Literal["auto", "torch", "onnx"]
Device = Literal["auto", "cpu", "cuda"]

Run = Callable[[Iterable[Batch]], Iterator[tuple[np.ndarray, np.ndarray]]]
"""Batches -> (row numbers, features float32 of shape (b, dim)) of each, in order."""


def choose(precision: Precision, runtime: Runtime, device: Device) -> tuple[str, str]:
    """(torch or onnx, cpu or cuda) for what was asked; raises UsageError when it cannot be.

    ONNX Runtime is the faster one in float32 on CPUs whose vector units torch's BLAS does not use
    to the full (measured: twice as fast on an AMD EPYC), and the only one with int8. It needs the
    extra `export` to make its graph.
    """
    import torch

    if device == "cuda" and not torch.cuda.is_available():
        raise UsageError("--device cuda: this torch finds no GPU; use --device cpu")
    if device == "auto":
        device = "cuda" if runtime != "onnx" and torch.cuda.is_available() else "cpu"
    if precision == "int8" and (runtime == "torch" or device == "cuda"):
        raise UsageError("--precision int8 runs in ONNX Runtime on a CPU: use --device cpu")
    if precision == "float16" and device == "cpu":
        raise UsageError("--precision float16 is for GPUs; on a CPU use bfloat16 or int8")
    if runtime == "onnx" and (precision == "bfloat16" or device == "cuda"):
        raise UsageError("--runtime onnx runs float32 and int8 on a CPU; use --runtime torch")
    if runtime == "auto":
        fast = device == "cpu" and precision == "float32" and _can_export()
        runtime = "onnx" if fast or precision == "int8" else "torch"
    return runtime, device


def _can_export() -> bool:
    from importlib.util import find_spec

    return find_spec("onnx") is not None and find_spec("onnxscript") is not None


def runners(
    model: TextModel,
    paths: dict[str, Path],
    precision: Precision,
    where: tuple[str, str],
    threads: int,
) -> tuple[Run, TextModel, Run]:
    """How to run a model, the model with the batches that suit, and how to run it in float32.

    paths : the files that the model was loaded from; a graph in the cache is theirs.
    where : as `choose` gives it.
    """
    import torch

    torch.set_num_threads(threads)
    if where[0] == "onnx":
        from .graphs import graph

        sources = {name: file_sha256(str(path)) for name, path in paths.items()}
        exact = in_onnx(graph(model, sources), threads)
        run = in_onnx(graph(model, sources, int8=True), threads) if precision == "int8" else exact
        return run, model, exact
    if where[1] == "cuda":
        model = replace(model, budget=model.budget * _GPU_FACTOR)
    exact = run = in_torch(model.module, "float32", where[1])
    if precision != "float32":
        run = in_torch(deepcopy(model.module), precision, where[1])
    return run, model, exact


def in_torch(module: "torch.nn.Module", precision: Precision, device: str) -> Run:
    """A module that takes the inputs of a batch by name, in torch.

    While a GPU computes one batch, the next one is made on the host.
    """
    import torch

    module = module.to(torch.device(device), getattr(torch, precision)).eval()

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
