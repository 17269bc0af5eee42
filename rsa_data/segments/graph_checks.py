"""Whether a graph is what its model card says, and what its other inputs are filled with."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..common.errors import RowError, RsaDataError, unknown
from .decoding import Decoder
from .preprocess import Geometry

if TYPE_CHECKING:
    import onnxruntime

# An input tensor with a batch of 1, and how the image lies in it.
Prepared = tuple[np.ndarray, Geometry]

# Beyond it products of two outputs and whole numbers leave what float32 and int64 can hold.
_LARGEST = 1e15

# numpy's types of ONNX's, of the inputs that a card can fill.
TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(int64)": np.int64,
    "tensor(bool)": np.bool_,
}


def check_inputs(
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
    kind = TYPES.get(graph_input.type, np.float32)
    fill = spec.get("fill", "")
    if fill == "ones":
        wanted = spec.get("shape", [1])
        if len(wanted) != len(graph_input.shape):
            raise RsaDataError(
                f"{where}: [input.others] shape {wanted}: expected {len(graph_input.shape)} sides"
            )
        shape = tuple(
            known if isinstance(known, int) else size
            for known, size in zip(graph_input.shape[1:], wanted[1:], strict=True)
        )
        return lambda images: np.ones((len(images), *shape), kind)
    if fill not in _FILLS:
        raise RsaDataError(f"{where}: {unknown('fill', fill, ('ones', *_FILLS))}")
    return lambda images: np.array([_FILLS[fill](g) for _, g in images], kind)


# Values of one image, height first: what PaddleDetection's graphs want beside the picture.
_FILLS: dict[str, Callable[[Geometry], tuple[float, float]]] = {
    "scale": lambda g: (g.used_height / g.height, g.used_width / g.width),
    "input-size": lambda g: (g.used_height, g.used_width),
    "image-size": lambda g: (g.height, g.width),
}


def check_outputs(
    session: "onnxruntime.InferenceSession",
    outputs: Mapping[str, str],
    decoder: Decoder,
    where: str,
    file: str,
) -> None:
    """Raises RsaDataError unless the graph has these outputs (role -> name), of fitting shapes."""
    there = {o.name: o.shape for o in session.get_outputs()}
    for role, name in outputs.items():
        if name not in there:
            raise RsaDataError(
                f"{where}: expected the output {name} ({role}) in {file}; found {', '.join(there)}"
            )
        if role in decoder.roles and there[name]:
            _check_shape(there[name], decoder.roles[role], f"{where}: output {name} of {file}")


def check_arrays(
    roles: Mapping[str, np.ndarray], decoder: Decoder, where: str, file: str, batch: int
) -> None:
    """Raises RsaDataError unless what a run gave has the shapes that its decoder reads."""
    for role, array in roles.items():
        what = f"{where}: output {role} of {file}"
        if role in decoder.roles:
            _check_shape(array.shape, decoder.roles[role], what)
        if decoder.batched and (array.ndim == 0 or len(array) != batch):
            raise RsaDataError(f"{what}: expected a batch of {batch}; found shape {array.shape}")


def check_numbers(array: np.ndarray, name: str) -> None:
    """Raises RowError for an output with nan, inf, or numbers beyond what decoders can use."""
    if not array.size:
        return
    low, high = float(array.min()), float(array.max())
    if not np.isfinite((low, high)).all():
        raise RowError(f"the model's output {name} holds nan or inf")
    if max(-low, high) > _LARGEST:
        raise RowError(
            f"the model's output {name} holds numbers up to {max(-low, high):.3g}: no score, "
            "coordinate or class"
        )


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
