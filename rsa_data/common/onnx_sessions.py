"""ONNX Runtime sessions on models' files."""

import contextlib
import ctypes
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from . import bounded, onnx_external
from .errors import RsaDataError, UsageError
from .progress import notice

if TYPE_CHECKING:
    import onnxruntime

# Bytes of a protobuf message.
_LARGEST = 2**31

Device = Literal["auto", "cpu", "cuda"]

_CUDA = "CUDAExecutionProvider"


def gpu_driver() -> bool:
    """Whether a GPU's driver can be loaded; without it neither torch nor onnxruntime finds one."""
    for driver in ("libcuda.so.1", "nvcuda.dll", "libamdhip64.so"):
        try:
            ctypes.CDLL(driver)
        except OSError:
            continue
        return True
    return False


def open_session(
    path: Path, threads: int = 1, device: Device = "auto"
) -> "onnxruntime.InferenceSession":
    """An onnxruntime session on a model's file.

    threads : CPU threads inside an operator.
    device : auto takes CUDA when this onnxruntime was built with it and can load it, else the CPU.
    Raises RsaDataError when onnxruntime cannot open the file, UsageError for cuda without CUDA.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    # Threads that wait sleep, as those of OpenMP do (see __main__.py): spinning took a third more
    # of the CPU, and a third more time where other workers wanted the cores.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 4  # what matters is raised as well
    providers: list[Any] = ["CPUExecutionProvider"]
    built = _CUDA in onnxruntime.get_available_providers()
    if device == "cuda" and not built:
        raise UsageError(
            "device cuda: this onnxruntime has no CUDA; install onnxruntime-gpu in its place"
        )
    on_gpu = built and device != "cpu" and gpu_driver()
    if device == "cuda" and not on_gpu:
        raise UsageError("device cuda: no GPU driver was found (libcuda.so.1); use --device cpu")
    if on_gpu:
        onnxruntime.set_default_logger_severity(4)  # what fails here is said below
        _find_cuda()
        # Algorithms chosen by trying them, which is EXHAUSTIVE, and TF32 would give other bits from
        # run to run. DEFAULT has been cuDNN's last resort since onnxruntime 1.20: on an H100 it
        # took 66 ms for an image of YOLOX nano.
        settings = {"cudnn_conv_algo_search": "HEURISTIC", "use_tf32": "0"}
        providers.insert(0, (_CUDA, settings))
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
        session = onnxruntime.InferenceSession(str(path), options, providers=providers)
    # onnxruntime's errors have no common base but Exception.
    except Exception as error:
        reason = " ".join(str(error).split())[:300]
        raise RsaDataError(
            f"{path}: expected an ONNX model that onnxruntime can run; found: {reason}"
        ) from error
    if on_gpu and _CUDA not in session.get_providers():
        # onnxruntime goes on without a word when a library is missing, many times slower.
        why = f"onnxruntime {onnxruntime.__version__} cannot load CUDA, or a library of its version"
        if device == "cuda":
            raise UsageError(f"device cuda: {why}; see its page on CUDA, or use --device cpu")
        notice(f"{path.name}: {why}: running on the CPU (--device cuda makes this an error)")
    return session


def _find_cuda() -> None:
    """Loads the libraries of CUDA that pip installs in folders of their own, as torch needs them.

    onnxruntime looks for them on the paths of the system alone.
    """
    import onnxruntime

    # Since 1.21. What it prints of libraries that it did not find is said above.
    if hasattr(onnxruntime, "preload_dlls"):
        with contextlib.redirect_stdout(io.StringIO()):
            onnxruntime.preload_dlls()
