"""ONNX Runtime sessions on models' files."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from . import bounded, onnx_external
from .errors import RsaDataError, UsageError

if TYPE_CHECKING:
    import onnxruntime

# Bytes of a protobuf message.
_LARGEST = 2**31

Device = Literal["auto", "cpu", "cuda"]


def open_session(
    path: Path, threads: int = 1, device: Device = "auto"
) -> "onnxruntime.InferenceSession":
    """An onnxruntime session on a model's file.

    threads : CPU threads inside an operator.
    device : auto takes CUDA when this onnxruntime was built with it, else the CPU.
    Raises RsaDataError when onnxruntime cannot open the file, UsageError for cuda without CUDA.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # what matters is raised as well
    providers: list[Any] = ["CPUExecutionProvider"]
    available = "CUDAExecutionProvider" in onnxruntime.get_available_providers()
    if device == "cuda" and not available:
        raise UsageError(
            "device cuda: this onnxruntime has no CUDA; install onnxruntime-gpu in its place"
        )
    if available and device != "cpu":
        # Tuned algorithms and TF32 would give other bits from run to run.
        settings = {"cudnn_conv_algo_search": "DEFAULT", "use_tf32": "0"}
        providers.insert(0, ("CUDAExecutionProvider", settings))
    try:
        bounded.check_file(path)
        size = path.stat().st_size
    except OSError as error:
        raise RsaDataError(f"{path}: expected an ONNX model; found: {error.strerror}") from error
    if size > _LARGEST:
        raise RsaDataError(
            f"{path}: expected an ONNX model, which has at most 2 GB; found {size:,} bytes"
        )
    onnx_external.refuse(path)
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=providers)
    # onnxruntime's errors have no common base but Exception.
    except Exception as error:
        reason = " ".join(str(error).split())[:300]
        raise RsaDataError(
            f"{path}: expected an ONNX model that onnxruntime can run; found: {reason}"
        ) from error
