"""A detector: the ONNX graph of a model card, checked against it, with its decoder."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import registry
from ..errors import RowError, RsaDataError
from ..models import Card, Device, open_session
from . import Segments, classes
from .classes import ClassTable
from .decoding import Decoder
from .found import to_segments
from .preprocess import Geometry, preprocessor

if TYPE_CHECKING:
    import onnxruntime

_TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(int64)": np.int64,
    "tensor(bool)": np.bool_,
}

Prepared = tuple[np.ndarray, Geometry]


@dataclass(frozen=True)
class Detector:
    """The three steps of detection; each is pure and may run in its own thread.

    prepare : RGB image uint8 (h, w, 3) -> input tensor with a batch of 1, and its geometry.
    run : tensors of one shape -> outputs of each, role -> array with a batch of 1.
    finish : outputs of one image, its geometry -> segments. Raises RowError.
    batches : whether `run` may be given more than one tensor.
    """

    prepare: Callable[[np.ndarray], Prepared]
    run: Callable[[Sequence[Prepared]], list[dict[str, np.ndarray]]]
    finish: Callable[[dict[str, np.ndarray], Geometry], Segments]
    batches: bool


def load(
    card: Card,
    path: Path,
    *,
    table: ClassTable,
    score_threshold: float | None = None,
    threads: int = 1,
    device: Device = "auto",
    features: str | None = None,
    with_masks: bool = False,
) -> Detector:
    """The detector of a card; the graph is checked here, as far as its shapes tell.

    Raises RsaDataError when the card is not complete or the graph is not what it says.
    """
    where = f"model card {card['name']}"
    for key in ("input", "output", "decoder", "classes"):
        if not isinstance(card.get(key), dict):
            raise RsaDataError(f"{where}: expected a section [{key}]; found none")
    settings = dict(card["decoder"])
    if score_threshold is not None:
        settings["score_threshold"] = score_threshold
    family = registry.resolve("decoder", registry.DECODERS, settings.get("family", ""))
    try:
        decoder: Decoder = family(settings, table)
    except KeyError as error:
        raise RsaDataError(
            f"{where}: [decoder] expected the setting {error}; found none"
        ) from error
    if missing := set(decoder.roles) - set(card["output"]):
        raise RsaDataError(
            f"{where}: [output] expected the names of {', '.join(decoder.roles)}; "
            f"found none for {', '.join(sorted(missing))}"
        )
    prepare = preprocessor(card["input"], where)
    session = open_session(path, threads, device)
    outputs = {role: card["output"][role] for role in decoder.roles}
    if features is not None:
        outputs["features"] = features
    fixed = _check_inputs(session, card["input"], where, path.name)
    _check_outputs(session, outputs, decoder, where, path.name)
    name = card["input"]["name"]
    kinds = {i.name: _TYPES.get(i.type, np.float32) for i in session.get_inputs()}

    def run(images: Sequence[Prepared]) -> list[dict[str, np.ndarray]]:
        batch = images[0][0] if len(images) == 1 else np.concatenate([p[0] for p in images])
        feed = {name: batch.astype(kinds[name], copy=False), **fixed(images)}
        try:
            arrays = session.run(list(outputs.values()), feed)
        # onnxruntime's errors have no common base but Exception.
        except Exception as error:
            reason = " ".join(str(error).split())[:300]
            raise RsaDataError(
                f"{where}: running {path.name} on an input of shape {batch.shape} failed: {reason}"
            ) from error
        arrays = [a.astype(np.float32) if a.dtype == np.float16 else a for a in arrays]
        roles = dict(zip(outputs, arrays, strict=True))
        _check_arrays(roles, decoder, where, path.name, len(images))
        if not decoder.batched:
            return [roles]
        return [{role: a[k : k + 1] for role, a in roles.items()} for k in range(len(images))]

    def finish(found: dict[str, np.ndarray], geometry: Geometry) -> Segments:
        for role, (_, axis, _) in decoder.roles.items():
            if axis and not np.isfinite(found[role]).all():
                raise RowError(f"the model's output {outputs[role]} holds nan or inf")
        result = decoder.decode(found, geometry)
        rows = None
        if features is not None:
            given = found["features"][0] if decoder.batched else found["features"]
            rows = _feature_rows(given, result.candidates, where, features)
        return to_segments(result, geometry.width, geometry.height, table, rows, with_masks)

    axis = next(i.shape for i in session.get_inputs() if i.name == name)[0]
    if any(not isinstance(side, int) for o in session.get_outputs() for side in o.shape or [""]):
        # The shapes do not tell all: one empty picture does, before the first part is begun.
        finish(*_first(run, prepare(np.full((64, 64, 3), 114, np.uint8))))
    return Detector(prepare, run, finish, decoder.batched and not isinstance(axis, int))


def _first(
    run: Callable[[Sequence[Prepared]], list[dict[str, np.ndarray]]], prepared: Prepared
) -> tuple[dict[str, np.ndarray], Geometry]:
    return run([prepared])[0], prepared[1]


def _check_inputs(
    session: "onnxruntime.InferenceSession", spec: dict[str, Any], where: str, file: str
) -> Callable[[Sequence[Prepared]], dict[str, np.ndarray]]:
    """Raises RsaDataError unless the card fills every input; returns what fills the others."""
    inputs = {i.name: i for i in session.get_inputs()}
    name, others = spec.get("name"), spec.get("others", {})
    if name not in inputs or set(inputs) - {name} - set(others):
        wanted = ", ".join(filter(None, [name, *others]))
        raise RsaDataError(
            f"{where}: expected the inputs {wanted} in {file}; found {', '.join(inputs)}"
        )
    image = inputs[name]
    if image.type not in ("tensor(float)", "tensor(float16)"):
        raise RsaDataError(
            f"{where}: expected input {name} of {file} to be float or float16; found {image.type}"
        )
    height, width = spec.get("size", (None, None))
    nhwc = spec.get("layout") == "NHWC"
    wanted_shape = (1, height, width, 3) if nhwc else (1, 3, height, width)
    clash = len(image.shape) != 4 or any(
        isinstance(found, int) and wanted is not None and found != wanted
        for found, wanted in zip(image.shape, wanted_shape, strict=True)
    )
    if clash:
        shape = ["?" if side is None else side for side in wanted_shape]
        raise RsaDataError(
            f"{where}: expected input {name} of {file} of shape {shape}; found {image.shape}"
        )
    fills = {
        key: _filler(inputs[key], what, where) for key, what in others.items() if key in inputs
    }
    return lambda images: {key: fill(images) for key, fill in fills.items()}


def _filler(
    graph_input: Any, spec: dict[str, Any], where: str
) -> Callable[[Sequence[Prepared]], np.ndarray]:
    """What fills an input besides the image, by its `fill` in the card."""
    kind = _TYPES.get(graph_input.type, np.float32)
    fill = spec.get("fill", "")
    if fill == "ones":
        wanted = spec.get("shape", [1])
        shape = tuple(
            known if isinstance(known, int) else size
            for known, size in zip(graph_input.shape[1:], wanted[1:], strict=True)
        )
        return lambda images: np.ones((len(images), *shape), kind)
    if fill not in _FILLS:
        raise RsaDataError(f"{where}: {registry.unknown('fill', fill, ('ones', *_FILLS))}")
    return lambda images: np.array([_FILLS[fill](g) for _, g in images], kind)


# Values of one image, height first: what PaddleDetection's graphs want beside the picture.
_FILLS: dict[str, Callable[[Geometry], tuple[float, float]]] = {
    "scale": lambda g: (g.used_height / g.height, g.used_width / g.width),
    "input-size": lambda g: (g.used_height, g.used_width),
    "image-size": lambda g: (g.height, g.width),
}


def _check_outputs(
    session: "onnxruntime.InferenceSession",
    outputs: Mapping[str, str],
    decoder: Decoder,
    where: str,
    file: str,
) -> None:
    there = {o.name: o.shape for o in session.get_outputs()}
    for role, name in outputs.items():
        if name not in there:
            raise RsaDataError(
                f"{where}: expected the output {name} ({role}) in {file}; found {', '.join(there)}"
            )
        if role in decoder.roles and there[name]:
            _check_shape(there[name], decoder.roles[role], f"{where}: output {name} of {file}")


def _check_arrays(
    roles: Mapping[str, np.ndarray], decoder: Decoder, where: str, file: str, batch: int
) -> None:
    for role, array in roles.items():
        what = f"{where}: output {role} of {file}"
        if role in decoder.roles:
            _check_shape(array.shape, decoder.roles[role], what)
        if decoder.batched and (array.ndim == 0 or len(array) != batch):
            raise RsaDataError(f"{what}: expected a batch of {batch}; found shape {array.shape}")


def _check_shape(shape: Sequence[Any], wanted: tuple[int, int, int], what: str) -> None:
    axes, axis, size = wanted
    if len(shape) != axes or (axis and isinstance(shape[axis], int) and shape[axis] != size):
        sides = ["?"] * axes
        if axis:
            sides[axis] = str(size)
        raise RsaDataError(
            f"{what}: expected shape [{', '.join(sides)}], by its family and class table; "
            f"found {list(shape)}"
        )


def _feature_rows(values: np.ndarray, candidates: int | None, where: str, name: str) -> np.ndarray:
    """An output without its batch, (rows, d) or (d, h, w) -> float32 (candidates, d)."""
    if values.ndim == 3:
        values = values.reshape(len(values), -1).T  # (h * w, d)
    if values.ndim != 2 or len(values) != candidates:
        raise RsaDataError(
            f"{where}: features {name}: expected one row for each of {candidates} candidates; "
            f"found shape {values.shape}"
        )
    return values.astype(np.float32)


def class_table(card: Card) -> ClassTable:
    """The class table of a card's [classes]: `table` by name (with its own `count`), or names."""
    spec = card.get("classes", {})
    where = f"model card {card['name']}: [classes]"
    if "table" in spec:
        shipped = classes.table(spec["table"])
        return ClassTable(shipped.names, shipped.things, spec.get("count", shipped.count))
    return classes.parse(spec, where)
