"""A detector: the ONNX graph of a model card, checked against it, with its decoder."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import registry
from ..common import class_names, forms
from ..common.cards import Card
from ..common.class_names import ClassTable
from ..common.errors import RowError, RsaDataError
from ..common.onnx_sessions import Device, open_session
from .decoding import Decoder
from .found import Found, to_segments
from .graph_checks import TYPES, Prepared, check_arrays, check_inputs, check_numbers, check_outputs
from .preprocess import Geometry, preprocessor
from .segments import Segments


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


_SETTINGS: dict[str, Any] = {f"{key}_threshold?": "a share from 0 to 1"
                             for key in ("score", "overlap", "own", "mask")}  # fmt: skip
_SETTINGS |= {
    f"{key}?": "text"
    for key in ("family", "score", "sigmoid", "masks_show", "coordinates", "layout")
}
_SETTINGS |= {"objectness?": "true or false", "columns_first?": "true or false"}
_SETTINGS |= {"columns?": ["text"], "axes?": "a count", "prototypes?": "a count"}
_SETTINGS |= {"through?": "text or two sides in px"}
_SETTINGS |= {"strides?": ["a side in px"], "smallest?": "a number", "mask_axes?": "a count"}
_FORM = {
    "input": {"name": "text", "others?": {"*": {"fill?": "text", "shape?": ["a side in px"]}}},
    "output": {"*": "text"},
    "decoder": _SETTINGS,
}


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
    where, settled = f"model card {card.name}", card.settings
    for key in ("input", "output", "decoder", "classes"):
        if not isinstance(settled.get(key), dict):
            raise RsaDataError(f"{where}: expected a section [{key}]; found none")
    forms.check(settled, _FORM, where)
    settings = dict(settled["decoder"])
    if score_threshold is not None:
        settings["score_threshold"] = score_threshold
    family = registry.resolve("decoder", registry.DECODERS, settings.get("family", ""))
    try:
        decoder: Decoder = family(settings, table)
    except KeyError as error:
        raise RsaDataError(
            f"{where}: [decoder] expected the setting {error}; found none"
        ) from error
    if missing := set(decoder.roles) - set(settled["output"]):
        raise RsaDataError(
            f"{where}: [output] expected the names of {', '.join(decoder.roles)}; "
            f"found none for {', '.join(sorted(missing))}"
        )
    prepare = preprocessor(settled["input"], where)
    session = open_session(path, threads, device)
    outputs = {role: settled["output"][role] for role in decoder.roles}
    if features is not None:
        outputs["features"] = features
    fixed = check_inputs(session, settled["input"], where, path.name)
    check_outputs(session, outputs, decoder, where, path.name)
    name = settled["input"]["name"]
    kinds = {i.name: TYPES.get(i.type, np.float32) for i in session.get_inputs()}

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
        check_arrays(roles, decoder, where, path.name, len(images))
        if not decoder.batched:
            return [roles]
        return [{role: a[k : k + 1] for role, a in roles.items()} for k in range(len(images))]

    def finish(found: dict[str, np.ndarray], geometry: Geometry) -> Segments:
        for role in decoder.roles:
            check_numbers(found[role], outputs[role])
        result = decoder.decode(found, geometry)
        _check_found(result, geometry, table)
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


def _check_found(found: Found, geometry: Geometry, table: ClassTable) -> None:
    """Raises RowError for classes and boxes that no detector with this table finds in an image."""
    if found.label is None and len(strange := found.number[found.number >= table.count]):
        raise RowError(
            f"the model answers with class {strange.max()}; its table ends at {table.count - 1}: "
            "other classes, or columns in another order"
        )
    if found.box is None or not len(found.box):
        return
    largest, side = np.abs(found.box).max(), max(geometry.width, geometry.height)
    if not largest <= 20 * side:
        raise RowError(
            f"a box reaches to {largest:.3g} px in an image of {geometry.width} x "
            f"{geometry.height}: was the file exported with its decoding inside?"
        )
    # Shares become px of the image by its scale in the input, which is no more than this.
    scale = max(geometry.width / geometry.used_width, geometry.height / geometry.used_height)
    if largest <= max(1.0, scale) and side > 32:
        raise RowError(
            "all boxes lie within 0 to 1 px: was the file exported with boxes as shares of the "
            'image? Its card needs coordinates = "shares" then'
        )


def _first(
    run: Callable[[Sequence[Prepared]], list[dict[str, np.ndarray]]], prepared: Prepared
) -> tuple[dict[str, np.ndarray], Geometry]:
    return run([prepared])[0], prepared[1]


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
    where = f"model card {card.name}: [classes]"
    form = {"table?": "text", "count?": "a class number"}
    spec = forms.check(card.settings.get("classes", {}), form, where)
    if "table" in spec:
        shipped = class_names.table(spec["table"])
        return ClassTable(shipped.names, shipped.things, spec.get("count", shipped.count))
    return class_names.parse(spec, where)
