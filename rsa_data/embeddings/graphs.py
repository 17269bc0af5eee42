"""ONNX graphs of encoders: exported once, checked against torch, kept in the user's cache."""

import errno
import hashlib
import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from ..common import bounded, files
from ..common.digests import read_sha256
from ..common.errors import RsaDataError
from ..common.extras import extras
from ..common.files import cache_folder
from ..common.progress import notice
from .encoder import TextModel
from .running import in_onnx, in_torch

# Bumped by hand when the modules' code changes in a way that an old graph would not follow.
_VERSION = 3

# What a graph may differ from torch by, in float32: 1 - cosine, and the norm's relative change.
_TOLERANCE = 1e-5

# Seconds that a process waits for another one's graph before it says so.
_SILENT = 3

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def graph(model: TextModel, sources: dict[str, str], *, int8: bool = False) -> Path:
    """The graph of an encoder, from the cache or made now.

    A graph that is not the one that was written there, by the digest beside it, is made anew.

    sources : what the encoder is made of, by name (its code, sha256 of its files); decides the
        place in the cache.
    int8 : weights rounded to 8 bits, activations at run time by their range in the batch.

    Raises RsaDataError when the extra `export` is missing, when the graph does not compute what
    torch does, or when the cache cannot be written.
    """
    exporter = metadata.version("torch")
    key = repr((_VERSION, sorted(sources.items()), exporter, sorted(model.axes.items())))
    folder = cache_folder("graphs") / hashlib.sha256(key.encode()).hexdigest()[:32]
    exact, rounded = folder / "float32.onnx", folder / "int8.onnx"
    wanted = rounded if int8 else exact
    try:
        if _intact(wanted):
            return wanted
        folder.mkdir(parents=True, exist_ok=True)
        with _one_at_a_time(folder / "lock"):
            # Another process may have made it meanwhile.
            if _intact(wanted):
                return wanted
            if not int8 or not _intact(exact):
                _make(exact, lambda path: _export(model, path))
            if int8:
                _make(rounded, lambda path: _quantize(exact, path))
    except OSError as error:
        raise RsaDataError(
            f"{folder}: expected to write the encoder's graph there: {error}. Set XDG_CACHE_HOME "
            "to a folder that can be written and has room, or use --runtime torch"
        ) from error
    return wanted


@contextmanager
def _one_at_a_time(lock: Path) -> Iterator[None]:
    """Lets one worker make a graph while the others wait for it."""
    from filelock import FileLock, Timeout

    _refuse_folder(lock)
    one = FileLock(lock)
    try:
        one.acquire(timeout=_SILENT)
    except Timeout:
        notice(
            f"Waiting for {lock}: another process is making this encoder's graph, which takes 10 "
            "to 30 s; one that is stopped keeps others waiting until it goes on or ends"
        )
        one.acquire()
    try:
        yield
    finally:
        one.release()


def _refuse_folder(path: Path) -> None:
    if path.is_dir():
        raise RsaDataError(
            f"{path}: expected a file of the cache of graphs; found a folder: remove it"
        )


def _make(target: Path, write: Callable[[Path], None]) -> None:
    """Writes a graph, and then its digest: a kill in between makes it anew the next time."""
    for path in (target, _digest(target)):
        _refuse_folder(path)
    if target.exists():
        why = "does not match its digest" if _digest(target).exists() else "has no digest"
        notice(f"{target}: this graph {why}; making it anew")
    with files.replacing(target) as file:
        # Exporter and quantiser open the file by its name.
        path = Path(file.name)
        write(path)
        record = _record(target, path)
    files.write(_digest(target), record)


def _intact(target: Path) -> bool:
    """Whether a file is the graph that `_make` wrote there.

    Against mishaps: whoever writes both files on purpose is believed.
    """
    if not target.is_file():
        return False
    try:
        return bounded.read(_digest(target), "text") == _record(target, target)
    except OSError:
        return False


def _digest(target: Path) -> Path:
    return target.with_name(f"{target.name}.sha256")


def _record(target: Path, path: Path) -> bytes:
    """The line of sha256sum for what `path` holds, with the folder: it is a digest of the key."""
    return f"{read_sha256(path)}  {target.parent.name}/{target.name}\n".encode()


def _export(model: TextModel, path: Path) -> None:
    with extras("an ONNX graph"):
        import onnx  # noqa: F401
        import onnxscript  # noqa: F401
    import torch

    batch = next(model.batches(_probe(model)[:4], 10_000))[1]
    # Axes that are 0 or 1 in the example would be taken for constants: these have more.
    dims = {axis: torch.export.Dim(axis, min=2) for axes in model.axes.values() for axis in axes}
    try:
        with _quiet():
            program = torch.onnx.export(
                model.module.eval(),
                (),
                kwargs={name: torch.from_numpy(batch[name]) for name in model.axes},
                dynamo=True,
                dynamic_shapes={
                    name: {i: dims[axis] for i, axis in enumerate(axes)}
                    for name, axes in model.axes.items()
                },
                input_names=list(model.axes),
                output_names=["features"],
                verbose=False,
            )
            assert program is not None
            program.save(path, external_data=False)
    # The exporter raises errors of many kinds for what it cannot translate.
    except Exception as error:
        if full := _full_disk(error):
            raise full from None
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        raise RsaDataError(
            f"this encoder cannot be exported as an ONNX graph: {reason}. Use --runtime torch"
        ) from error
    _check(model, path)


def _full_disk(error: BaseException | None) -> OSError | None:
    """The error of a disk without room among an error and what it came from."""
    while error:
        if isinstance(error, OSError) and error.errno in _FULL:
            return error
        error = error.__cause__ or error.__context__
    return None


def _probe(model: TextModel) -> Any:
    """Token ids of texts from the shortest to longer than the encoder reads."""
    words = [
        "an",
        "image",
        "with",
        "two",
        "beds,",
        "a",
        "traffic",
        "light",
        "and",
        "13.42%",
        "sky",
        "漢字",
    ]
    texts = ["", "a", "a bed", "An image with a bed.", *(" ".join(words * n) for n in (1, 3, 40))]
    return model.tokenize(texts)[0]


def _check(model: TextModel, path: Path) -> None:
    """Raises RsaDataError unless the graph gives torch's features, for one text and for many."""
    ids = _probe(model)
    in_graph, in_module = in_onnx(path, 1), in_torch(model.module, "float32", "cpu")
    for some in (ids, ids[:1], ids[-1:], ids[1:3]):
        batches = list(model.batches(some, 10_000))
        for (_, found), (_, wanted) in zip(in_graph(batches), in_module(batches), strict=True):
            norms = np.linalg.norm(found, axis=1), np.linalg.norm(wanted, axis=1)
            cosine = (found * wanted).sum(1) / (norms[0] * norms[1])
            off = max(np.max(1 - cosine), np.max(np.abs(norms[0] / norms[1] - 1)))
            if not off <= _TOLERANCE:
                raise RsaDataError(
                    f"the exported graph differs from torch by {off:.1e}; expected at most "
                    f"{_TOLERANCE:.0e}. Use --runtime torch, and please report the versions of "
                    "torch and onnxscript"
                )


def _quantize(source: Path, path: Path) -> None:
    with extras("an int8 graph"):
        import onnx
    from onnxruntime.quantization import quantize_dynamic

    model = onnx.load(source)
    # The shapes that torch wrote down contradict those of the quantised graph.
    del model.graph.value_info[:]
    with _quiet():
        quantize_dynamic(model, path, op_types_to_quantize=["MatMul", "Gemm"], per_channel=True)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silences what exporter and quantiser say of themselves; what fails is raised all the same."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)
