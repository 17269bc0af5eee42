"""What family of detector an ONNX file is, by its metadata, names and shapes: its card, made here.

Nothing is guessed: a file that can be read in two ways is refused with both, and what a card needs.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..common.cards import Card
from ..common.class_names import ClassTable
from ..common.errors import RsaDataError
from .onnx_metadata import CARD, STRIDES, Graph, look, probe

_V10 = ["x1", "y1", "x2", "y2", "score", "class"]
_CENTRES = ["x", "y", "w", "h", "score", "class"]


@dataclass(frozen=True)
class Recognised:
    """A file's card and classes, and in a few words what it was taken for."""

    card: Card
    table: ClassTable
    told: str


def recognise(session: Any, file: str, names: ClassTable | None) -> Recognised:
    """The card of an open ONNX session.

    names : the classes that the user gave; else those of the file's metadata.
    Raises RsaDataError for a file of no known family, or of several.
    """
    graph = look(session, file, names)
    if (task := graph.meta.get("task", "detect")) not in ("detect", "segment"):
        raise RsaDataError(f"{file}: expected a detector, found a model of the task {task!r}")
    for family in (_by_names, _rows, _grid):
        if found := family(graph, file):
            settings, told = found
            break
    else:
        shapes = ", ".join(f"{name} {shape}" for name, shape in graph.outputs.items())
        raise RsaDataError(
            f"{file}: expected the outputs of a known family (rsa-data list decoders) for "
            f"{graph.classes} classes; found {shapes}. {CARD}"
        )
    what = f"{told}, {graph.classes} classes, {graph.width} x {graph.height} px"
    return Recognised(Card(name="onnx", kind="segments", settings=settings), graph.table, what)


def _card(
    graph: Graph,
    output: dict[str, str],
    decoder: dict[str, Any],
    *,
    resize: str = "centred",
    raw: bool = False,
    others: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """A card's sections. raw : BGR of 0 to 255 (YOLOX), else RGB of 0 to 1."""
    given: dict[str, Any] = {"name": graph.name, "resize": resize, "pad": 114}
    given |= {"size": [graph.height, graph.width], "layout": "NHWC" if graph.nhwc else "NCHW"}
    given |= {"colour": "BGR"} if raw else {"colour": "RGB", "scale": 1 / 255}
    given |= {"others": others} if others else {}
    decoder = {"score_threshold": 0.25, **decoder}
    return {"input": given, "output": output, "decoder": decoder, "classes": {}}


_Found = tuple[dict[str, Any], str] | None


def _by_names(graph: Graph, file: str) -> _Found:
    """Graphs that name what they answer: DETR's kin, torchvision, RT-DETR, TensorRT's own."""
    logits = next((n for n in ("logits", "pred_logits") if n in graph.outputs), None)
    if logits and "pred_boxes" in graph.outputs:
        columns = graph.outputs[logits][-1]
        kinds = {graph.classes + 1: "softmax", graph.classes: "sigmoid"}
        if columns not in kinds:
            raise RsaDataError(
                f"{file}: expected {logits} of {graph.classes} classes, or with one more for none; "
                f"found {columns} columns"
            )
        kind = kinds[columns]
        mean, std = [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]
        settings = _card(
            graph,
            {"classes": logits, "boxes": "pred_boxes"},
            {"family": "detr", "score": kind, "score_threshold": 0.5},
            resize="stretch",
        )
        settings["input"]["resample"] = "pillow"  # as transformers' image processors
        if kind == "softmax":  # RT-DETR and D-FINE take plain 0 to 1
            settings["input"] |= {"mean": mean, "std": std}
        return settings, f"DETR or one of its kin ({kind} scores)"
    spoken = {"num_dets", "det_boxes", "det_scores", "det_classes"}
    if spoken <= graph.outputs.keys():
        if "stride" not in graph.meta:
            raise RsaDataError(
                f"{file}: outputs {', '.join(graph.outputs)} without metadata can be read in "
                "several ways: YOLOv6 takes RGB / 255, or BGR of 0 to 255 if exported with its "
                "preprocessing; DAMO-YOLO pads at the right and below, and its export for "
                f"onnxruntime mixes up corners and centres. {CARD}: [decoder] family = "
                '"final-boxes" with axes = 3 and coordinates = "input"'
            )
        output = {"boxes": "det_boxes", "scores": "det_scores", "classes": "det_classes"}
        decoder = {"family": "final-boxes", "axes": 3, "coordinates": "input"}
        return _card(graph, output, decoder), "YOLO with suppression by TensorRT's names"
    if {"boxes", "scores", "labels"} <= graph.outputs.keys():
        output = {"boxes": "boxes", "scores": "scores", "classes": "labels"}
        axes = len(graph.outputs["boxes"])
        decoder = {"family": "final-boxes", "axes": axes, "coordinates": "input"}
        inputs = {i.name for i in graph.session.get_inputs()}
        if "orig_target_sizes" in inputs:
            if graph.height != graph.width:
                raise RsaDataError(f"{file}: expected a square input of RT-DETR. {CARD}")
            others = {"orig_target_sizes": {"fill": "input-size"}}
            settings = _card(graph, output, decoder, resize="stretch", others=others)
            settings["input"]["resample"] = "pillow"  # as its own scripts
            return settings, "RT-DETR with its post-processing"
        settings = _card(graph, output, decoder | {"score_threshold": 0.5})
        return settings, "torchvision detection (boxes, labels, scores)"
    return None


def _rows(graph: Graph, file: str) -> _Found:
    """Graphs that answer with final rows: (n, 7), (1, n, 6), and with mask terms (1, n, 38)."""
    name, shape = next(iter(graph.outputs.items()))
    planes = _prototypes(graph)
    if graph.is_rtdetr:
        return _rtdetr(graph, file, name, shape)
    if len(shape) == 2 and shape[1] in (6, 7):
        raise RsaDataError(
            f"{file}: output {name} {shape} can be read in several ways: YOLOv7 writes batch x1 y1 "
            "x2 y2 class score, others x1 y1 x2 y2 score class (batch) or class score x1 y1 x2 y2. "
            f'{CARD}: [decoder] family = "final-rows" with columns = [...]'
        )
    if len(shape) != 3 or shape[2] != 6 + planes or shape[1] in (graph.cells, 3 * graph.cells):
        return None
    if "task" not in graph.meta:
        raise RsaDataError(
            f"{file}: output {name} {shape} without metadata can be read in several ways: x1 y1 x2 "
            "y2 score class (YOLOv10), class score x1 y1 x2 y2 (PaddleDetection), or x y w h "
            f'objectness class of one class. {CARD}: [decoder] family = "final-rows" with columns'
        )
    output = {"rows": name}
    decoder: dict[str, Any] = {"family": "final-rows", "axes": 3, "columns": _V10}
    decoder |= {"coordinates": "input"}
    if planes:
        output["prototypes"] = list(graph.outputs)[1]
        decoder["prototypes"] = planes
    return _card(graph, output, decoder), "Ultralytics, end to end (x1 y1 x2 y2 score class)"


def _rtdetr(graph: Graph, file: str, name: str, shape: list[Any]) -> _Found:
    """Ultralytics' RT-DETR: shares x y w h with a score a class, or, since 8.4, its best class.

    With two classes both have 6 columns; only the later form ends in whole numbers.
    """
    final = shape[-1] == 6
    if final and graph.classes == 2:
        last = probe(graph, name)[:, 5]
        final = bool((last == np.round(last)).all())
    if len(shape) != 3 or not (final or shape[2] == 4 + graph.classes):
        return None
    decoder: dict[str, Any] = {"family": "yolo", "overlap_threshold": 1.0}
    output = {"predictions": name}
    if final:
        decoder = {"family": "final-rows", "axes": 3, "columns": _CENTRES}
        output = {"rows": name}
    decoder |= {"coordinates": "shares"}
    return _card(graph, output, decoder, resize="stretch"), "Ultralytics RT-DETR"


def _prototypes(graph: Graph) -> int:
    """How many prototypes a second output of 4 axes has; 0 without one."""
    shapes = list(graph.outputs.values())
    second = shapes[1] if len(shapes) > 1 else []
    return second[1] if len(second) == 4 and isinstance(second[1], int) else 0


def _grid(graph: Graph, file: str) -> _Found:
    """Graphs with a row for every cell, decoded inside or raw (YOLOX)."""
    name, shape = next(iter(graph.outputs.items()))
    if len(shape) != 3:
        return None
    planes = _prototypes(graph)
    output = {"predictions": name}
    decoder: dict[str, Any] = {"family": "yolo"}
    if planes:
        output["prototypes"] = list(graph.outputs)[1]
        decoder["prototypes"] = planes
    free, rated = 4 + graph.classes + planes, 5 + graph.classes + planes
    sides = shape[1:]
    if sides[0] == free and sides[1] != free:
        decoder |= {"columns_first": True}
        return _card(graph, output, decoder), f"Ultralytics v8 to v11{_with(planes)}"
    if sides[1] != rated:
        return None
    decoder |= {"objectness": True}
    if sides[0] == 3 * graph.cells or "stride" in graph.meta:
        return _card(graph, output, decoder), f"YOLOv5 or YOLOv7{_with(planes)}"
    rows = probe(graph, name)
    if len(rows) == 3 * graph.cells:
        return _card(graph, output, decoder), f"YOLOv5 or YOLOv7{_with(planes)}"
    if len(rows) != graph.cells:
        return None
    if (rows[:, 4] == 1).all():
        return _card(graph, output, decoder), "YOLOv6"
    if np.abs(rows[:, 2:4]).max() > 20:
        return _card(
            graph, output, decoder, raw=True, resize="letterbox"
        ), "YOLOX with its decoding inside"
    raw = {"family": "yolox", "strides": list(STRIDES), "overlap_threshold": 0.45}
    return _card(graph, output, raw, raw=True, resize="letterbox"), "YOLOX"


def _with(planes: int) -> str:
    return " with masks" if planes else ""
