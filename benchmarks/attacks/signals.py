"""SIGINT and SIGTERM at many moments: every command must end within 5 seconds."""

import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from .harness import ANY, Attack
from .images import folder, picture
from .onnx import graph, write
from .world import World


def endless(box: Path) -> None:
    """A depth model whose graph loops for years."""
    from onnx import TensorProto, helper

    from .images import depth

    depth(box, lambda p: None, "in/depth", ".none")
    body = helper.make_graph(
        [helper.make_node("Identity", ["c"], ["c2"]), helper.make_node("Sin", ["v"], ["v2"])],
        "b",
        [
            helper.make_tensor_value_info("i", TensorProto.INT64, ()),
            helper.make_tensor_value_info("c", TensorProto.BOOL, ()),
            helper.make_tensor_value_info("v", TensorProto.FLOAT, None),
        ],
        [
            helper.make_tensor_value_info("c2", TensorProto.BOOL, ()),
            helper.make_tensor_value_info("v2", TensorProto.FLOAT, None),
        ],
    )
    nodes = [
        helper.make_node("ReduceMean", ["images"], ["m"], axes=[1], keepdims=0),
        helper.make_node("Loop", ["n", "t", "m"], ["y"], body=body),
    ]
    constants = {"n": np.array(2**62, np.int64), "t": np.array(True)}
    write(
        box / "m.onnx", graph(nodes, {"y": (TensorProto.FLOAT, (1, "h", "w"))}, constants=constants)
    )


def attacks(world: World) -> Iterator[Attack]:
    def pictures(box: Path) -> None:
        folder(box, lambda p: picture().save(p))

    remote = f"http://127.0.0.1:{world.port}"
    loop = (
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
    silent = (
        "embed-images",
        "--work",
        "work",
        "--dataset",
        "folder:own",
        "--encoder",
        "thumbnail",
        "--root",
    )
    asked = (
        "captions",
        "--work",
        "work",
        "--dataset",
        "folder:own",
        "--root",
        "in",
        "--style",
        "vlm:eyes",
        "--endpoint",
    )
    cases = {
        "a graph that loops": (loop, endless, (5.0,)),
        "a graph that loops, two workers": ((*loop, "--workers", "2"), endless, (8.0,)),
        "a silent file server": ((*silent, f"{remote}/root-silence"), None, (5.0,)),
        "a silent listing": ((*silent, f"{remote}/root-list_silence"), None, (5.0,)),
        "a file server that fails": ((*silent, f"{remote}/root-503"), None, (6.0,)),
        "a silent model server": ((*asked, f"{remote}/vlm-silence"), pictures, (7.0,)),
        "a model server that fails": ((*asked, f"{remote}/vlm-503"), pictures, (7.0,)),
        "a silent bucket": (("status", "--work", "s3://bucket/x"), None, (6.0,)),
        "demo": (("demo", "--work", "work"), None, (0.0, 0.05, 0.2, 0.5, 1.0, 2.0, 4.0, 8.0, 12.0)),
        "train-head": (
            ("train-head", "--work", "work", "--name", "x", "--epochs", "100000", "--threads", "1"),
            lambda b: world.copy(b),
            (3.0, 10.0),
        ),
        "play": (
            ("play", "--work", "work", "--no-show", "--port", "0"),
            lambda b: world.copy(b),
            (2.0, 12.0),
        ),
    }
    address = {
        "AWS_ENDPOINT_URL_S3": f"{remote}/s3-silence",
        "AWS_ENDPOINT_URL": f"{remote}/s3-silence",
        "AWS_ACCESS_KEY_ID": "x",
        "AWS_SECRET_ACCESS_KEY": "x",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ALLOW_HTTP": "true",
    }
    for name, (words, prepare, moments) in cases.items():
        for sent in (signal.SIGINT, signal.SIGTERM):
            for moment in moments:
                yield Attack(
                    f"{sent.name} after {moment} s: {name}",
                    words,
                    prepare,
                    may=ANY,
                    after=(moment, sent),
                    environment=address,
                )
