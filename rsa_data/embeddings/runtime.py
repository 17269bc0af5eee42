"""Where and in which precision an encoder runs, and what runs it there."""

from copy import deepcopy
from dataclasses import replace
from typing import Literal

from ..common.errors import UsageError
from ..common.onnx_sessions import gpu_driver
from ..runner.cpu import cpu_type
from .encoder import TextModel
from .graphs import graph
from .running import Precision, Run, in_onnx, in_torch

# A GPU wants larger batches than a CPU's cache does.
_GPU_FACTOR = 64

Runtime = Literal["auto", "torch", "onnx"]
Device = Literal["auto", "cpu", "cuda"]


def choose(precision: Precision, runtime: Runtime, device: Device) -> tuple[str, str]:
    """(torch or onnx, cpu or cuda) for what was asked; raises UsageError when it cannot be.

    ONNX Runtime is the faster one in float32 on CPUs whose vector units torch's BLAS does not use
    to the full (measured: twice as fast on an AMD EPYC), and the only one with int8. It needs the
    extra `export` to make its graph.
    """
    if device == "cuda" and not _gpu():
        raise UsageError("--device cuda: this torch finds no GPU; use --device cpu")
    if device == "auto":
        device = "cuda" if runtime != "onnx" and _gpu() else "cpu"
    if precision == "int8" and (runtime == "torch" or device == "cuda"):
        raise UsageError(
            "--precision int8 runs in ONNX Runtime on a CPU: leave out "
            + ("--runtime torch" if runtime == "torch" else "--device cuda")
        )
    if precision == "float16" and device == "cpu":
        raise UsageError("--precision float16 is for GPUs; on a CPU use bfloat16 or int8")
    if runtime == "onnx" and (precision == "bfloat16" or device == "cuda"):
        raise UsageError("--runtime onnx runs float32 and int8 on a CPU; use --runtime torch")
    if runtime == "auto":
        fast = device == "cpu" and precision == "float32" and _can_export()
        runtime = "onnx" if fast or precision == "int8" else "torch"
    return runtime, device


def native_precision(runtime: Runtime, device: Device) -> Precision:
    """bfloat16 where the processor that would run the encoder computes in it, else float32."""
    if runtime == "onnx":
        return "float32"
    if device == "cuda" or (device == "auto" and _gpu()):
        import torch

        return "bfloat16" if torch.cuda.is_bf16_supported(including_emulation=False) else "float32"
    # x86 and Arm have their own names for it.
    native = {"avx512_bf16", "bf16"} & set(cpu_type().split())
    return "bfloat16" if native else "float32"


def _gpu() -> bool:
    """Whether torch finds a GPU; without a driver it is not even imported, which takes a second."""
    if not gpu_driver():
        return False
    import torch

    return torch.cuda.is_available()


def _can_export() -> bool:
    from importlib.util import find_spec

    return find_spec("onnx") is not None and find_spec("onnxscript") is not None


def runners(
    model: TextModel,
    sources: dict[str, str],
    precision: Precision,
    where: tuple[str, str],
    threads: int,
) -> tuple[Run, TextModel, Run]:
    """How to run a model, the model with the batches that suit, and how to run it in float32.

    sources : what the model was made of, its code and its files; a graph in the cache is theirs.
    where : as `choose` gives it.

    Raises UsageError for a precision that the encoder is not run in.
    """
    if precision == "int8" and model.no_int8:
        raise UsageError(f"--precision int8: {model.no_int8}. Use --precision bfloat16 or float32")
    if where[0] == "onnx":
        exact = in_onnx(graph(model, sources), threads)
        run = in_onnx(graph(model, sources, int8=True), threads) if precision == "int8" else exact
        return run, model, exact
    import torch

    torch.set_num_threads(threads)
    if where[1] == "cuda":
        model = replace(model, budget=model.budget * _GPU_FACTOR)
    exact = run = in_torch(model.module, "float32", where[1])
    if precision != "float32":
        run = in_torch(deepcopy(model.module), precision, where[1])
    return run, model, exact
