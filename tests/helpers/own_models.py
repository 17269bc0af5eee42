"""ONNX graphs made here, whose answers are the picture's colours, and detect run on them."""

import numpy as np
import pyarrow as pa

from rsa_data.datasets.dataset import Dataset
from rsa_data.segments import detect
from rsa_data.store import schemas

DATASET = Dataset(
    "folder",
    index=lambda root, split: None,
    read_depth=lambda path: None,
    min_depth=1e-3,
    max_depth=10,
)


def run(root, images, **options):
    samples = pa.table({"sample_id": images, "image": pa.array(images, pa.string())})
    found = detect.build(dataset=DATASET, root=root, **options)(samples)
    schemas.check("segments", found)
    return found


def write_graph(path, nodes, inputs, outputs, constants=()):
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    def value(name, shape, kind=TensorProto.FLOAT):
        return helper.make_tensor_value_info(name, kind, shape)

    graph = helper.make_graph(
        [helper.make_node(*node[:3], **(node[3] if len(node) > 3 else {})) for node in nodes],
        "g",
        [value(*given) for given in inputs],
        [value(*given) for given in outputs],
        [numpy_helper.from_array(np.asarray(array), name) for name, array in constants],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, path)
    return path


def write_semantic(path, batch="b", height=4, width=4):
    """A graph that answers the picture itself: the brightest channel is the class."""
    return write_graph(
        path,
        [("Identity", ["x"], ["y"]), ("ReduceMean", ["x"], ["z"], {"axes": [2, 3], "keepdims": 0})],
        [("x", [batch, 3, height, width])],
        [("y", [batch, 3, height, width]), ("z", [batch, 3])],
    )


CARD = """
kind = "segments"
licence = "mine"
[input]
name = "x"
resize = "stretch"
size = [4, 4]
scale = 0.1
[output]
map = "y"
[decoder]
family = "semantic"
[classes]
names = ["red", "", "blue"]
things = "none"
"""
