"""all-MiniLM-L6-v2 in int8, whole and in part, against float32 and bfloat16.

    python benchmarks/int8.py TEXTS.json [--rounds 5] [--threads 1]

TEXTS.json is a list of captions. Weights are rounded per channel, activations at run time. In turn
these stay in float32: nothing; products without weights (attention); the first and last layer too;
all but the MLP; all but what widens (the inputs of the MLP and of attention). A way to run int8
would need a cosine of .998 at 1.5 times the speed of bfloat16. Time is CPU seconds, the best round.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path

import numpy as np
import recording
import torch

from rsa_data.common import minilm
from rsa_data.common.digests import file_sha256
from rsa_data.common.pretrained import folder_files
from rsa_data.embeddings import sentence
from rsa_data.embeddings.batches import by_length
from rsa_data.embeddings.graphs import graph
from rsa_data.embeddings.running import in_onnx, in_torch

WIDE = ([384, 1152], [384, 1536])
INNER = ([384, 1536], [1536, 384])


def rounded(source: Path, folder: Path) -> dict[str, Path]:
    """int8 graphs by what is rounded."""
    import onnx
    from onnxruntime.quantization import quantize_dynamic

    whole = onnx.load(source)
    shapes = {weight.name: list(weight.dims) for weight in whole.graph.initializer}
    products = [n for n in whole.graph.node if n.op_type in ("MatMul", "Gemm")]
    weight_of = {n.name: next((shapes[i] for i in n.input if i in shapes), None) for n in products}
    weighted = [name for name, shape in weight_of.items() if shape is not None]
    layer = len(weighted) // 6
    ways = {
        "int8, all products": list(weight_of),
        "int8, without attention": weighted,
        "int8, without first and last layer": weighted[layer:-layer],
        "int8, MLP alone": [n for n in weighted if weight_of[n] in INNER],
        "int8, what widens alone": [n for n in weighted if weight_of[n] in WIDE],
    }
    made = {}
    for number, (way, names) in enumerate(ways.items()):
        model = onnx.load(source)
        # The shapes that torch wrote down contradict those of the quantised graph.
        del model.graph.value_info[:]
        made[way] = folder / f"{number}.onnx"
        quantize_dynamic(
            model, made[way], op_types_to_quantize=["MatMul", "Gemm"], per_channel=True,
            nodes_to_quantize=names,
        )  # fmt: skip
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("texts", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=1)
    given = parser.parse_args()
    torch.set_num_threads(given.threads)
    files = folder_files(minilm.folder_with("model.safetensors"))
    model = sentence.load(files)
    ids, _ = model.tokenize(json.loads(given.texts.read_text()))
    exact = graph(model, {name: file_sha256(str(path)) for name, path in files.items()})
    ways: dict[str, Callable] = {
        "float32": in_onnx(exact, given.threads),
        "bfloat16": in_torch(deepcopy(model.module), "bfloat16", "cpu"),
    }
    with tempfile.TemporaryDirectory() as folder:
        for name, path in rounded(exact, Path(folder)).items():
            ways[name] = in_onnx(path, given.threads)
    best, features = dict.fromkeys(ways, float("inf")), {}
    for _ in range(given.rounds):
        for name, run in ways.items():
            found = np.empty((len(ids), model.dim), np.float32)
            begun = time.process_time()
            for rows, some in run(by_length(ids, model.budget)):
                found[rows] = some
            best[name] = min(best[name], time.process_time() - begun)
            features[name] = found
    table = []
    for name, took in best.items():
        cosine = (features[name] * features["float32"]).sum(1)
        figures = cosine.min(), np.median(cosine)
        table.append((name, round(len(ids) / took), round(best["bfloat16"] / took, 2),
                      *(round(float(value), 5) for value in figures)))  # fmt: skip
        print(*table[-1])
    recording.table(
        "int8",
        "all-MiniLM-L6-v2 in int8",
        ("way", "texts/s", "times bfloat16", "cosine, least", "cosine, median"),
        table,
        note=f"{len(ids)} texts, {np.mean([len(row) for row in ids]):.1f} tokens each.",
        rounds=given.rounds,
        threads=given.threads,
    )


if __name__ == "__main__":
    main()
