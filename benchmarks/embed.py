"""Captions a second of CLIP RN50's text tower: the reference way, and ours at each precision.

    python benchmarks/embed.py [--release DIR_OR_ARCHIVE] [--texts 1500] [--threads 1]

--release : `nyu-train.tar.xz` with the released texts, or a clone of the RSA repository's text
folder. A fixed draw: the distinct lines of consecutive images of one scene after another, as they
stand together in a part.

Ways, all with the same random weights and the same threads:

- reference: transformers' CLIPTextModelWithProjection, texts in their order, padded to 77 tokens,
  float32, batches of 8 and of 64; on the first texts of the draw only, because its rate does not
  depend on which texts they are;
- sorted: our tower with ONNX Runtime in length-sorted batches without padding, nothing shared;
- float32, bfloat16, int8: as `embed` runs them, shared beginnings computed once.

With one thread, times are CPU seconds of this process, so that other work on the machine does not
count; with more they are wall time, so keep the machine quiet. Rounds of all ways alternate.
"""

import argparse
import hashlib
import tarfile
import tempfile
import time
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path

import numpy as np
import recording
import torch

from rsa_data.common.tokenizers import clip
from rsa_data.embeddings.batches import PREFIX_AXES, by_length, by_prefix
from rsa_data.embeddings.clip_text import TextTower
from rsa_data.embeddings.encoder import Batch, Ids, TextModel
from rsa_data.embeddings.graphs import graph
from rsa_data.embeddings.running import in_onnx, in_torch

DEFAULT = Path(__file__).parents[2] / "shared" / "data" / "rsa_release" / "nyu-train.tar.xz"
BUDGET = 512
REFERENCE_TEXTS = 64


def captions(release: Path) -> Iterator[list[str]]:
    """The lines of each image of NYU train, in the order of samples."""
    if release.is_file():
        with tarfile.open(release) as archive:
            names = [n for n in archive.getnames() if "text_all" in n and n.endswith(".txt")]
            wanted = dict.fromkeys(names)
            found = {
                member.name: archive.extractfile(member).read().decode()
                for member in archive
                if member.name in wanted
            }
        texts = [found[name] for name in sorted(found)]
    else:
        paths = sorted(release.glob("**/text_all/nyu/train/**/*.txt"))
        texts = [path.read_text("utf-8") for path in paths]
    for text in texts:
        yield [line for line in text.splitlines() if line.strip()]


def draw(images: list[list[str]], count: int) -> list[str]:
    """`count` distinct texts of consecutive images, beginning at the middle."""
    texts: dict[str, None] = {}
    for lines in images[len(images) // 2 :]:
        texts.update(dict.fromkeys(lines))
        if len(texts) >= count:
            break
    return list(texts)[:count]


def alone(ids: Ids, budget: int) -> Iterator[Batch]:
    """Length-sorted batches in which nothing is shared: every text its own tree."""
    for rows, inputs in by_length(ids, budget):
        lengths, t = inputs["lengths"], inputs["ids"].shape[1]
        columns = np.arange(t)
        inside = columns < lengths[:, None]
        starts = np.concatenate([[0], np.cumsum(lengths)[:-1]])
        yield (
            rows,
            {
                "ids": inputs["ids"][inside],
                "positions": np.broadcast_to(columns, inside.shape)[inside],
                "paths": np.where(inside, starts[:, None] + columns, 0),
                "places": np.flatnonzero(inside),
                "ends": starts + lengths - 1,
            },
        )


def random_tower() -> TextTower:
    """RN50's text tower with weights as OpenAI's code draws them before training."""
    torch.manual_seed(0)
    tower, width, layers = TextTower().eval(), 512, 12
    spread = {
        "token_embedding": 0.02,
        "positional_embedding": 0.01,
        "in_proj_weight": width**-0.5,
        "out_proj.weight": width**-0.5 * (2 * layers) ** -0.5,
        "c_proj.weight": width**-0.5 * (2 * layers) ** -0.5,
        "c_fc.weight": (2 * width) ** -0.5,
        "text_projection": width**-0.5,
    }
    with torch.no_grad():
        for name, parameter in tower.named_parameters():
            found = [value for key, value in spread.items() if key in name]
            if found:
                parameter.normal_(std=found[0])
            elif name.endswith("bias"):
                parameter.normal_(std=0.02)
            else:
                parameter.normal_(1, 0.1)
    return tower


def reference(tower: TextTower) -> torch.nn.Module:
    """transformers' model with the same weights."""
    from transformers import CLIPTextConfig, CLIPTextModelWithProjection

    config = CLIPTextConfig(
        vocab_size=49408,
        hidden_size=512,
        intermediate_size=2048,
        num_hidden_layers=12,
        num_attention_heads=8,
        max_position_embeddings=77,
        projection_dim=1024,
        hidden_act="quick_gelu",
        bos_token_id=49406,
        eos_token_id=49407,
    )
    ours = tower.state_dict()
    theirs = {
        "text_model.embeddings.token_embedding.weight": ours["token_embedding.weight"],
        "text_model.embeddings.position_embedding.weight": ours["positional_embedding"],
        "text_model.final_layer_norm.weight": ours["ln_final.weight"],
        "text_model.final_layer_norm.bias": ours["ln_final.bias"],
        "text_projection.weight": ours["text_projection"].T,
    }
    names = {"ln_1": "layer_norm1", "ln_2": "layer_norm2", "mlp.c_fc": "mlp.fc1"}
    names |= {"mlp.c_proj": "mlp.fc2", "attn.out_proj": "self_attn.out_proj"}
    for i in range(12):
        for kind in ("weight", "bias"):
            block, layer = f"transformer.resblocks.{i}", f"text_model.encoder.layers.{i}"
            for own, name in names.items():
                theirs[f"{layer}.{name}.{kind}"] = ours[f"{block}.{own}.{kind}"]
            parts = ours[f"{block}.attn.in_proj_{kind}"].chunk(3)
            for letter, part in zip("qkv", parts, strict=True):
                theirs[f"{layer}.self_attn.{letter}_proj.{kind}"] = part
    model = CLIPTextModelWithProjection(config).eval()
    model.load_state_dict(theirs, strict=False)
    return model


@torch.inference_mode()
def run_reference(model: torch.nn.Module, ids: Ids, batch: int) -> np.ndarray:
    """All texts in their order, padded to 77."""
    full = torch.zeros((len(ids), 77), dtype=torch.long)
    for row, one in enumerate(ids):
        full[row, : len(one)] = torch.tensor(one)
    return torch.cat([model(input_ids=part).text_embeds for part in full.split(batch)]).numpy()


def matrix_peak(threads: int) -> float:
    """GFLOP/s of this CPU in a float32 matrix product of the tower's largest kind."""
    import onnx
    from onnx import helper, numpy_helper

    weights = np.random.default_rng(0).standard_normal((512, 2048), np.float32)
    shape = helper.make_tensor_value_info
    made = helper.make_graph(
        [helper.make_node("MatMul", ["x", "w"], ["y"])],
        "product",
        [shape("x", onnx.TensorProto.FLOAT, [BUDGET, 512])],
        [shape("y", onnx.TensorProto.FLOAT, [BUDGET, 2048])],
        [numpy_helper.from_array(weights, "w")],
    )
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    x = np.random.default_rng(1).standard_normal((BUDGET, 512), np.float32)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "product.onnx"
        onnx.save(model, path)
        run = in_onnx(path, threads)
        batches = [(np.zeros(0), {"x": x})] * 60
        best = min(timed(lambda: list(run(batches)), threads)[0] for _ in range(5))
    return 60 * 2 * BUDGET * 512 * 2048 / best / 1e9


def operations(batches: list[Batch]) -> float:
    """Floating-point operations of the tower on these batches, matrix products only."""
    total, width = 0.0, 512
    for _, inputs in batches:
        m, (b, t) = len(inputs["ids"]), inputs["paths"].shape
        total += 11 * (24 * m * width**2 + 4 * b * t * t * width)
        total += 4 * m * width**2 + 20 * b * width**2 + 4 * b * t * width + 2 * b * width * 1024
    return total


def timed(call: Callable[[], object], threads: int) -> tuple[float, object]:
    clock = time.process_time if threads == 1 else time.perf_counter
    begun = clock()
    result = call()
    return clock() - begun, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--release", type=Path, default=DEFAULT)
    parser.add_argument("--texts", type=int, default=1500)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=2)
    given = parser.parse_args()
    torch.set_num_threads(given.threads)

    images = list(captions(given.release))
    texts = draw(images, given.texts)
    ids, _ = clip().encode(texts)
    lengths = np.array([len(row) for row in ids])
    tower = random_tower()
    model = TextModel(lambda: tower, clip().encode, by_prefix, BUDGET, PREFIX_AXES, 1024, False)
    sources = {"benchmark": hashlib.sha256(str(torch.__version__).encode()).hexdigest()}
    trees, apart = list(by_prefix(ids, BUDGET)), list(alone(ids, BUDGET))
    nodes = sum(len(inputs["ids"]) for _, inputs in trees)
    print(
        f"{len(texts)} distinct texts of {len(images)} images, {lengths.mean():.1f} tokens on "
        f"average, {lengths.max()} at most; {1 - nodes / lengths.sum():.0%} of the tokens stand in "
        f"a shared beginning; {given.threads} threads"
    )
    theirs = reference(tower)
    exact = in_onnx(graph(model, sources), given.threads)
    ours = {
        "sorted": (exact, apart),
        "float32": (exact, trees),
        "float32 in torch": (in_torch(tower, "float32", "cpu"), trees),
        "bfloat16": (in_torch(deepcopy(tower), "bfloat16", "cpu"), trees),
        "int8": (in_onnx(graph(model, sources, int8=True), given.threads), trees),
    }
    some = ids[:REFERENCE_TEXTS]
    best: dict[str, float] = {}
    features: dict[str, np.ndarray] = {}
    for _ in range(given.rounds):
        for batch in (8, 64):
            name = f"reference, batches of {batch}"
            took, expected = timed(lambda b=batch: run_reference(theirs, some, b), given.threads)
            best[name] = max(best.get(name, 0), len(some) / took)
        for name, (run, batches) in ours.items():
            took, found = timed(lambda r=run, b=batches: list(r(b)), given.threads)
            best[name] = max(best.get(name, 0), len(ids) / took)
            features[name] = np.concatenate([f for _, f in found])[
                np.argsort(np.concatenate([rows for rows, _ in found]))
            ]
    slow = max(rate for name, rate in best.items() if name.startswith("reference"))
    for name, rate in best.items():
        line = f"{name:24} {rate:8.1f} captions/s  {rate / slow:5.1f}x"
        if name in features:
            found = features[name][: len(some)]
            norms = np.linalg.norm(found, axis=1), np.linalg.norm(expected, axis=1)
            cosine = (found * expected).sum(1) / norms[0] / norms[1]
            off = np.abs(norms[0] / norms[1] - 1).max()
            line += f"   cosine {cosine.min():.7f}  norm {off:.1e}"
        print(line)
    recording.table(
        "embed",
        "CLIP RN50's text tower",
        ("way", "captions/s", "times the reference"),
        [(name, round(rate, 1), round(rate / slow, 1)) for name, rate in best.items()],
        note=f"{len(texts)} released captions, {lengths.mean():.1f} tokens each, random weights; "
        f"{1 - nodes / lengths.sum():.0%} of the tokens stand in a shared beginning.",
        threads=given.threads,
        rounds=given.rounds,
    )
    peak, done = matrix_peak(given.threads), operations(trees) / len(ids)
    print(f"float32 against the reference: {best['float32'] / slow:.1f}x (goal 3.5x)")
    print(f"int8 against our float32: {best['int8'] / best['float32']:.2f}x (goal 2.2x)")
    print(f"shared beginnings alone: {best['float32'] / best['sorted']:.2f}x (goal 1.3x)")
    print(
        f"arithmetic: {best['float32'] * done / 1e9:.0f} GFLOP/s in float32, "
        f"{best['float32'] * done / 1e9 / peak:.0%} of this CPU's {peak:.0f} in a matrix product"
    )
    lines = [line for lines in images for line in lines]
    parts = [images[i : i + 5000] for i in range(0, len(images), 5000)]
    distinct = sum(len({line for lines in part for line in lines}) for part in parts)
    print(
        f"distinct within parts of 5,000 images: {distinct / len(lines):.1%} of {len(lines)} texts"
    )


if __name__ == "__main__":
    main()
