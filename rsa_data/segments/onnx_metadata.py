"""What an ONNX file tells of a detector: its input, outputs, metadata and classes."""

import ast
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..common.class_names import ClassTable, parse
from ..common.errors import RsaDataError

STRIDES = (8, 16, 32)
CARD = "Describe the file by a card of your own (--card; see docs, Your own detector)"


@dataclass(frozen=True)
class Graph:
    """What is known of a graph: its input, outputs (name -> shape), metadata and classes."""

    session: Any
    name: str
    height: int
    width: int
    nhwc: bool
    outputs: dict[str, list[Any]]
    meta: dict[str, str]
    table: ClassTable

    @property
    def classes(self) -> int:
        return self.table.count

    @property
    def is_rtdetr(self) -> bool:
        """Whether Ultralytics exported its RT-DETR; before 8.4 only the description says so."""
        told = self.meta.get("head", "") + self.meta.get("description", "")
        return "task" in self.meta and "rtdetr" in told.lower().replace("-", "")

    @property
    def cells(self) -> int:
        """Cells of the grids of strides 8, 16 and 32 over the input."""
        return sum(-(-self.height // s) * -(-self.width // s) for s in STRIDES)

    def shape(self, *names: str) -> list[Any] | None:
        """The shape of the first output of these names."""
        return next((self.outputs[n] for n in names if n in self.outputs), None)


def look(session: Any, file: str, names: ClassTable | None) -> Graph:
    """What an open session tells; names : the classes that the user gave, else the metadata's."""
    meta: dict[str, str] = dict(session.get_modelmeta().custom_metadata_map)
    pictures = [i for i in session.get_inputs() if len(i.shape) == 4]
    if len(pictures) != 1:
        raise RsaDataError(f"{file}: expected one input of 4 axes, found {len(pictures)}. {CARD}")
    shape = pictures[0].shape
    nhwc = shape[3] == 3 and shape[1] != 3
    sides = shape[1:3] if nhwc else shape[2:4]
    if not all(isinstance(side, int) for side in sides):
        sides = _size(meta, file, shape)
    table = names or _table(meta, file)
    outputs = {o.name: list(o.shape) for o in session.get_outputs()}
    graph = Graph(session, pictures[0].name, sides[0], sides[1], nhwc, outputs, meta, table)
    open_sides = any(not isinstance(side, int) for shape in outputs.values() for side in shape[1:])
    if open_sides and len(session.get_inputs()) == 1:
        # An export with dynamic sides: what the graph answers tells them.
        there = dict(zip(outputs, _answers(graph, list(outputs)), strict=True))
        shapes = {name: [*outputs[name][:1], *array.shape[1:]] for name, array in there.items()}
        graph = replace(graph, outputs=shapes)
    return graph


def _size(meta: dict[str, str], file: str, shape: list[Any]) -> list[int]:
    """Height and width of the input by `imgsz` of the metadata."""
    found = _literal(meta.get("imgsz", ""))
    sides = [found, found] if isinstance(found, int) else found
    if not isinstance(sides, list) or [type(side) for side in sides] != [int, int]:
        raise RsaDataError(
            f"{file}: expected an input of a fixed size, or imgsz in its metadata; found {shape}. "
            f"{CARD}"
        )
    return sides


def _table(meta: dict[str, str], file: str) -> ClassTable:
    found = _literal(meta.get("names", ""))
    if isinstance(found, dict):
        found = {str(number): name for number, name in found.items()}
    if not found:
        raise RsaDataError(
            f"{file}: expected the names of its classes in its metadata, found none. Give them "
            "with --names: a file with one name a line, or a table such as coco"
        )
    return parse({"names": found}, f"{file}: metadata names")


def _literal(text: str) -> Any:
    """The value of a Python literal, as Ultralytics writes metadata; None for anything else."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return None


def probe(graph: Graph, name: str) -> np.ndarray:
    """What the graph answers to an empty picture, (n, columns): tells raw from decoded."""
    rows: np.ndarray = _answers(graph, [name])[0][0]
    return rows


def _answers(graph: Graph, names: list[str]) -> list[np.ndarray]:
    """Some outputs of the graph for an empty picture."""
    sides = (graph.height, graph.width)
    shape = (1, *sides, 3) if graph.nhwc else (1, 3, *sides)
    half = graph.session.get_inputs()[0].type == "tensor(float16)"
    grey = np.full(shape, 114, np.float16 if half else np.float32)
    try:
        return [np.asarray(a) for a in graph.session.run(names, {graph.name: grey})]
    # onnxruntime's errors have no common base but Exception.
    except Exception as error:
        raise RsaDataError(f"running the file on an empty picture failed: {error}") from error
