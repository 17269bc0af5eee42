"""This project against what people would take instead: the same work, both sides in one run.

    python benchmarks/peers.py [--texts 5500] [--rounds 3] [--threads 1] [--peer-python PYTHON]

Text embedding with all-MiniLM-L6-v2: `rsa-data embed` (the whole command: work dir, receipts,
audit) against sentence-transformers, its torch and its ONNX backend (batches of 32, sorted by
length, as its `encode` does). Every run is a process of its own; rounds of all ways alternate;
figures are medians. Texts are the distinct occupancy captions of the released NYU test segments.

--peer-python : a Python that has sentence-transformers with the ONNX backend, which wants another
    transformers than this project. --peer-model : the model's folder for it, with onnx/model.onnx.

CPU seconds of a process and its children are what is compared, so that other work on the machine
counts little; with one thread they add up to the time on a free core. Features are compared by
their cosine with those of sentence-transformers in torch.
"""

import argparse
import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import numpy as np

from rsa_data.common import minilm
from rsa_data.runner.cpu import cpu_type
from rsa_data.store import schemas
from rsa_data.store.tables import WorkDir

RELEASE = Path(__file__).parents[2] / "shared" / "data" / "rsa_release" / "nyu-test.tar.xz"
RESULTS = Path(__file__).parent / "results"
CAPTIONS = "captions/occupancy"

PEER = """
import json, sys
import numpy as np
from sentence_transformers import SentenceTransformer
folder, backend, texts, out, threads = sys.argv[1:]
import torch
torch.set_num_threads(int(threads))
options = {}
if backend == "onnx":
    import onnxruntime
    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads = int(threads)
    options = {"model_kwargs": {"session_options": settings, "file_name": "onnx/model.onnx"}}
model = SentenceTransformer(folder, backend=backend, device="cpu", **options)
np.save(out, model.encode(json.load(open(texts)), batch_size=32))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--release", type=Path, default=RELEASE)
    parser.add_argument("--texts", type=int, default=5500)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--peer-python", default=sys.executable)
    parser.add_argument("--peer-model", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        write(measure(given, Path(folder)), given)


def measure(given: argparse.Namespace, folder: Path) -> dict[str, dict[str, float]]:
    """CPU seconds, texts/s and least cosine of every way, medians over the rounds."""
    texts = prepare(given, folder)
    model = str(given.peer_model or minilm.folder_with("model.safetensors"))
    ways: dict[str, Callable[[], np.ndarray]] = {
        "sentence-transformers, torch": lambda: peer(given, folder, model, "torch"),
        "rsa-data, float32": lambda: ours(given, folder, texts, "float32"),
        "rsa-data, bfloat16": lambda: ours(given, folder, texts, "bfloat16"),
    }
    if given.peer_model:
        ways["sentence-transformers, ONNX"] = lambda: peer(given, folder, model, "onnx")
    ours(given, folder, texts, "float32")  # makes the graph, once and for all
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    cosine, exact = {}, None
    for number in range(given.rounds):
        for name, way in ways.items():
            begun = spent()
            features = way()
            seconds[name].append(spent() - begun)
            print(f"round {number + 1}: {name}: {seconds[name][-1]:.1f} s of CPU", flush=True)
            exact = features if exact is None else exact
            norms = np.linalg.norm(features, axis=1) * np.linalg.norm(exact, axis=1)
            cosine[name] = float(((features * exact).sum(1) / norms).min())
    return {
        name: {
            "cpu_s": statistics.median(took),
            "texts_per_s": len(texts) / statistics.median(took),
            "cosine_min": cosine[name],
        }
        for name, took in seconds.items()
    }


def prepare(given: argparse.Namespace, folder: Path) -> list[str]:
    """A work dir whose captions hold the texts; gives the texts in the order of the table."""
    with tarfile.open(given.release) as archive:
        archive.extractall(folder / "release", filter="data")
    text = next(p.parent for p in (folder / "release").rglob("seg_txt_panoptic"))
    variants = str(max(1, -(-given.texts // 620)))
    command = ["captions", "--dataset", "nyuv2", "--segments", f"rsa-release:{text}"]
    run_cli(given, folder, *command, "--variants", variants, "--tokenizer", "minilm")
    table = WorkDir(str(folder / "work")).table("nyuv2", CAPTIONS)
    found: dict[str, None] = {}
    for part in table.parts():
        found.update(dict.fromkeys(table.read(part, columns=["text"])["text"].to_pylist()))
    (folder / "texts.json").write_text(json.dumps(list(found)))
    return list(found)


def ours(given: argparse.Namespace, folder: Path, texts: list[str], precision: str) -> np.ndarray:
    """`rsa-data embed`, and its features in the order of `texts`."""
    options = ("--encoder", "minilm", "--precision", precision, "--store", "float32")
    run_cli(given, folder, "embed", *options, "--threads", str(given.threads), "--start-over")
    work = WorkDir(str(folder / "work"))
    made, captions = (
        work.table("nyuv2", "embeddings/occupancy/minilm"),
        work.table("nyuv2", CAPTIONS),
    )
    features: dict[str, np.ndarray] = {}
    for part in made.parts():
        rows = captions.read(part, columns=["text", "text_id"])
        text_of = dict(zip(rows["text_id"].to_pylist(), rows["text"].to_pylist(), strict=True))
        table = made.read(part)
        for text_id, row in zip(
            table["text_id"].to_pylist(), schemas.embedding_array(table), strict=True
        ):
            features[text_of[text_id]] = row
    return np.stack([features[text] for text in texts]).astype(np.float32)


def peer(given: argparse.Namespace, folder: Path, model: str, backend: str) -> np.ndarray:
    """sentence-transformers in a process of its own."""
    out = folder / "peer.npy"
    arguments = [model, backend, str(folder / "texts.json"), str(out), str(given.threads)]
    run(given, [given.peer_python, "-c", PEER, *arguments])
    return np.load(out)


def run_cli(given: argparse.Namespace, folder: Path, *arguments: str) -> None:
    run(given, [sys.executable, "-m", "rsa_data", *arguments, "--work", str(folder / "work")])


def run(given: argparse.Namespace, command: list[str]) -> None:
    threads = {"OMP_NUM_THREADS": str(given.threads), "TOKENIZERS_PARALLELISM": "false"}
    done = subprocess.run(command, env=os.environ | threads, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(command[:4])}: {done.stderr[-2000:]}")


def spent() -> float:
    """CPU seconds of the processes that this one has started and waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def write(found: dict[str, dict[str, float]], given: argparse.Namespace) -> None:
    """The figures as benchmarks/results/peers.json and a table."""
    versions = {n: metadata.version(n) for n in ("rsa-data", "torch", "onnxruntime")}
    about = {
        "date": datetime.now(UTC).date().isoformat(),
        "machine": f"{cpu_type()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.0f}",
        "python": platform.python_version(),
        "versions": versions,
        "texts": given.texts,
        "threads": given.threads,
        "rounds": given.rounds,
    }
    RESULTS.mkdir(exist_ok=True)
    content = {"about": about, "text embedding, whole process": found}
    (RESULTS / "peers.json").write_text(json.dumps(content, indent=2) + "\n")
    best = max(v["texts_per_s"] for n, v in found.items() if not n.startswith("rsa-data"))
    for name, v in found.items():
        print(
            f"{name:32} {v['cpu_s']:8.1f} s of CPU {v['texts_per_s']:8.0f} texts/s "
            f"{v['texts_per_s'] / best:6.2f} x the best peer, cosine {v['cosine_min']:.5f}"
        )


if __name__ == "__main__":
    main()
