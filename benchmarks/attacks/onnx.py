"""ONNX models, cards and depth models: graphs that are none, lie, or answer nonsense."""

import os
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from .harness import ACCEPTED, CONTAINED, REFUSED, Attack
from .images import folder, picture, sparse
from .world import World

CARD = """\
kind = "segments"
licence = "none"
decoder = "nms-rows"
input = "images"
size = [32, 32]
layout = "nchw"
"""
DETECT = (
    "detect",
    "--work",
    "work",
    "--dataset",
    "folder:own",
    "--root",
    "in",
)


def graph(
    nodes: list[Any],
    answers: dict[str, tuple[Any, ...]],
    shape: tuple[Any, ...] = (1, 3, "h", "w"),
    given: str = "images",
    constants: dict[str, Any] | None = None,
) -> Any:
    from onnx import TensorProto, helper, numpy_helper

    ends = [
        helper.make_tensor_value_info(name, kind, dims) for name, (kind, dims) in answers.items()
    ]
    start = helper.make_tensor_value_info(given, TensorProto.FLOAT, shape)
    kept = [numpy_helper.from_array(value, name) for name, value in (constants or {}).items()]
    made = helper.make_graph(nodes, "g", [start], ends, kept)
    return helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)


def depth_graph(operation: str) -> Any:
    """A depth model: the mean over colours, and then one operation."""
    import numpy as np
    from onnx import TensorProto, helper

    nodes = [helper.make_node("ReduceMean", ["images"], ["m"], axes=[1], keepdims=0)]
    constants: dict[str, Any] = {}
    answer: tuple[Any, ...] = (TensorProto.FLOAT, (1, "h", "w"))
    if operation == "good":
        nodes.append(helper.make_node("Identity", ["m"], ["y"]))
    elif operation == "nan":
        constants["c"] = np.full((1,), np.nan, np.float32)
        nodes.append(helper.make_node("Mul", ["m", "c"], ["y"]))
    elif operation == "inf":
        constants["c"] = np.full((1,), np.inf, np.float32)
        nodes.append(helper.make_node("Add", ["m", "c"], ["y"]))
    elif operation == "constant":
        constants["c"] = np.zeros((1,), np.float32)
        nodes.append(helper.make_node("Mul", ["m", "c"], ["y"]))
    elif operation == "one number":
        nodes.append(helper.make_node("ReduceMean", ["m"], ["y"], keepdims=0))
        answer = (TensorProto.FLOAT, ())
    elif operation == "text":
        nodes.append(helper.make_node("Cast", ["m"], ["y"], to=TensorProto.STRING))
        answer = (TensorProto.STRING, (1, "h", "w"))
    elif operation == "complex rank":
        constants["s"] = np.array([1, 1, 1, 1, -1], np.int64)
        nodes.append(helper.make_node("Reshape", ["m", "s"], ["y"]))
        answer = (TensorProto.FLOAT, (1, 1, 1, 1, "n"))
    elif operation == "nothing":
        constants |= {
            "s": np.array([0], np.int64),
            "e": np.array([0], np.int64),
            "a": np.array([1], np.int64),
        }
        nodes.append(helper.make_node("Slice", ["m", "s", "e", "a"], ["y"]))
    elif operation == "400 GB":
        constants["s"] = np.array([100_000, 1_000_000], np.int64)
        nodes += [
            helper.make_node("ConstantOfShape", ["s"], ["z"]),
            helper.make_node("ReduceSum", ["z"], ["q"], keepdims=0),
            helper.make_node("Add", ["m", "q"], ["y"]),
        ]
    elif operation == "unknown operator":
        nodes.append(helper.make_node("Bogus", ["m"], ["y"]))
    elif operation == "operator of others":
        nodes.append(helper.make_node("Evil", ["m"], ["y"], domain="evil.com"))
    elif operation == "a ring":
        nodes += [
            helper.make_node("Add", ["m", "r"], ["y"]),
            helper.make_node("Identity", ["y"], ["r"]),
        ]
    return graph(nodes, {"y": answer}, constants=constants)


def write(path: Path, model: Any) -> None:
    import onnx

    onnx.save(model, path)


def _depth_card(box: Path) -> None:
    """A model of one's own stands where the shipped card's file would be cached."""


def _bytes(world: World) -> Iterator[tuple[str, Callable[[Path], object]]]:
    real = world.shared / "models" / "yolox_nano.onnx"
    yield "nothing in it", lambda p: p.write_bytes(b"")
    yield "zeros", lambda p: p.write_bytes(bytes(10_000))
    yield "noise", lambda p: p.write_bytes(random.Random(0).randbytes(10_000))
    yield "text", lambda p: p.write_text("\x1b[31mhello")
    yield "sparse, 20 GB", lambda p: sparse(p, 20 << 30, b"\x08\x08")
    yield "a pipe", lambda p: os.mkfifo(p)
    yield "a folder", lambda p: p.mkdir()
    yield "/dev/zero", lambda p: p.symlink_to("/dev/zero")
    yield "a link to nowhere", lambda p: p.symlink_to("nowhere")
    if not real.is_file():
        return
    data = real.read_bytes()
    yield "cut", lambda p: p.write_bytes(data[: len(data) // 2])
    yield "header only", lambda p: p.write_bytes(data[:100])
    for number in range(12):

        def flipped(p: Path, n: int = number) -> None:
            chance, changed = random.Random(n), bytearray(data)
            for _ in range(40):
                # Structure, not weights: those lie together in the middle.
                changed[chance.randrange(2000)] ^= 1 << chance.randrange(8)
            p.write_bytes(bytes(changed))

        yield f"flipped {number}", flipped
    for kind in ("nested graphs", "external data", "nan weights"):
        yield kind, lambda p, k=kind: _changed(p, data, k)


def _part(number: int, content: bytes) -> bytes:
    """A field of a protobuf message that holds bytes."""
    size, length = len(content), b""
    while size > 127:
        length, size = length + bytes([size & 127 | 128]), size >> 7
    return bytes([number << 3 | 2]) + length + bytes([size]) + content


def _changed(path: Path, data: bytes, kind: str) -> None:
    import numpy as np
    import onnx
    from onnx import numpy_helper

    model = onnx.load_from_string(data)
    if kind == "external data":
        tensor = model.graph.initializer[0]
        tensor.ClearField("raw_data")
        tensor.data_location = onnx.TensorProto.EXTERNAL
        tensor.external_data.add(key="location", value="/etc/passwd")
    elif kind == "nan weights":
        for tensor in model.graph.initializer:
            values = numpy_helper.to_array(tensor)
            if values.dtype == np.float32:
                tensor.CopyFrom(numpy_helper.from_array(np.full_like(values, np.nan), tensor.name))
    else:
        # By hand: the library itself refuses to write so deep a graph. A field that stands twice is
        # merged, so that the model gets one node more.
        inner = b""
        for _ in range(60):
            attribute = _part(1, b"then_branch") + _part(6, inner) + b"\xa0\x01\x05"
            node = _part(1, b"c") + _part(2, b"d") + _part(4, b"If") + _part(5, attribute)
            inner = _part(1, node)
        path.write_bytes(data + _part(7, inner))
        return
    path.write_bytes(model.SerializeToString())


_CARDS: dict[str, bytes] = {
    "empty": b"",
    "not TOML": b"[[[",
    "not UTF-8": b"\xff\xfe",
    "nested": b"a = " + b"[" * 100_000,
    "inline tables": b"a = " + b"{a=" * 5000,
    "5,000 digits": b"size = " + b"9" * 5000,
    "dotted": b".".join([b"a"] * 20_000) + b" = 1",
    "size -1": CARD.replace("[32, 32]", "[-1, 32]").encode(),
    "size 2^40": CARD.replace("[32, 32]", "[1099511627776, 32]").encode(),
    "size text": CARD.replace("[32, 32]", '"x"').encode(),
    "a decoder that runs": CARD.replace("nms-rows", "os:system").encode(),
    "no decoder": CARD.replace('decoder = "nms-rows"', "").encode(),
    "name with slashes": b'name = "../../x"\n' + CARD.encode(),
    "url of a file": b'url = "file:///etc/passwd"\nsha256 = "' + b"0" * 64 + b'"\n' + CARD.encode(),
    "kind depth": CARD.replace('"segments"', '"relative-depth"').encode(),
    "control characters": CARD.replace('"nms-rows"', '"\\u001b[31m"').encode(),
    "mean of zeros": CARD.encode() + b"mean = [0, 0, 0]\nstd = [0, 0, 0]\n",
    "mean nan": CARD.encode() + b"mean = [nan, 0, 0]\nstd = [1, 1, 1]\n",
}


def attacks(world: World) -> Iterator[Attack]:
    real = world.shared / "models" / "yolox_nano.onnx"
    nano = (*DETECT, "--segments", "yolox-nano", "--segmenter-weights", "m.onnx")

    def put(box: Path, make: Callable[[Path], object]) -> None:
        folder(box, lambda p: picture().save(p))
        make(box / "m.onnx")

    if real.is_file():
        yield Attack(
            "control: yolox-nano",
            nano,
            lambda b: put(b, lambda p: p.symlink_to(real)),
            may=ACCEPTED,
        )
    for name, make in _bytes(world):
        # A flip may change a name or a producer's version only, and the model is whole then.
        may = CONTAINED | ACCEPTED if name.startswith("flipped") else CONTAINED
        yield Attack(f"model: {name}", nano, lambda b, m=make: put(b, m), may=may)
    card = (*DETECT, "--card", "own.toml", "--segmenter-weights", "m.onnx", "--segments", "own")
    for name, data in _CARDS.items():
        yield Attack(
            f"card: {name}",
            card,
            lambda b, d=data: (
                put(b, lambda p: write(p, depth_graph("good"))),
                (b / "own.toml").write_bytes(d),
            ),
            may=CONTAINED,
            check=lambda box, said: "it ran code" if (box / "owned").exists() else None,
        )
    yield Attack(
        "card: 20 GB",
        card,
        lambda b: (put(b, lambda p: p.touch()), sparse(b / "own.toml", 20 << 30, b"a = 1\n")),
    )
    yield Attack(
        "card: a pipe", card, lambda b: (put(b, lambda p: p.touch()), os.mkfifo(b / "own.toml"))
    )
    depth = (
        "depth",
        "--work",
        "work",
        "--dataset",
        "folder:own",
        "--root",
        "in",
        "--depth-model",
        "tu2020",
        "--depth-weights",
        "m.onnx",
        "--dataset-option",
        "depth=depth",
        "--dataset-option",
        "depth_unit=mm",
    )
    for operation in (
        "nan",
        "inf",
        "constant",
        "one number",
        "text",
        "complex rank",
        "nothing",
        "400 GB",
        "unknown operator",
        "operator of others",
        "a ring",
    ):
        yield Attack(
            f"depth model: {operation}",
            depth,
            lambda b, o=operation: (_with_depth(b), write(b / "m.onnx", depth_graph(o))),
            may=CONTAINED,
        )
    yield Attack(
        "predict: a model of text",
        (
            "predict",
            "--work",
            "work",
            "--image",
            "in/a.png",
            "--segmenter",
            "yolox-nano",
            "--segmenter-model",
            "m.onnx",
        ),
        lambda b: (world.copy(b), put(b, lambda p: p.write_text("x"))),
        may=REFUSED,
    )


def _with_depth(box: Path) -> None:
    from .images import depth

    depth(box, lambda p: None, "in/depth", ".none")
