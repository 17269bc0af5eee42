"""Text embedding on a GPU: what of the card's matrix rate it reaches, and whole commands.

    python benchmarks/gpu.py --release nyu-train.tar.xz [--minilm DIR] [--texts 20000]
        [--workers 1,4] [--device cuda] [--folder DIR]

First the card: a bfloat16 product of two matrices of 8192 x 8192, which is the rate that shares
are of. Then networks alone, in batches that lie in memory already, with the floating-point
operations that torch counts. Then `rsa-data embed` on all released captions of NYUv2 train, whole
processes, against sentence-transformers on the same texts and card. Features are compared with
those of float32 on the CPU.

--minilm : all-MiniLM-L6-v2; without it there is only CLIP, whose weights are random here: time does
    not depend on them. --device cpu tries the script where there is no GPU; writes no results.
"""

import argparse
import json
import re
import sys
import tarfile
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import recording
import torch
from embed import captions, random_tower
from torch.utils.flop_counter import FlopCounterMode

from rsa_data.common.tokenizers import clip
from rsa_data.embeddings import sentence
from rsa_data.embeddings.batches import PREFIX_AXES, by_prefix
from rsa_data.embeddings.clip_text import TextTower
from rsa_data.embeddings.encoder import TextModel
from rsa_data.embeddings.frozen import features_of
from rsa_data.embeddings.runtime import runners
from rsa_data.store.tables import WorkDir

SIDE = 8192


def card_rate(device: str, precision: str) -> float:
    """TFLOP/s of a product of two square matrices of random numbers."""
    side = SIDE if device == "cuda" else 1024
    a, b = (torch.randn(side, side, device=device, dtype=getattr(torch, precision)) for _ in "ab")
    seconds = [timed(lambda: a @ b, device) for _ in range(20)]
    return 2 * side**3 / float(np.median(seconds[5:])) / 1e12


def timed(call: Callable[[], Any], device: str) -> float:
    """Seconds of a call, its work on the device included."""
    if device == "cuda":
        torch.cuda.synchronize()
    begun = time.perf_counter()
    call()
    if device == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter() - begun


def towers() -> Iterator[tuple[str, TextModel]]:
    """CLIP's text towers in two sizes, with random weights."""
    small = random_tower()
    yield (
        "CLIP RN50, random",
        TextModel(lambda: small, clip().encode, by_prefix, 512, PREFIX_AXES, 1024, False),
    )
    torch.manual_seed(0)
    large = TextTower(width=768, heads=12, dim=768).eval()
    for parameter in large.parameters():
        torch.nn.init.normal_(parameter, std=0.02)
    yield (
        "CLIP ViT-L/14, random",
        TextModel(lambda: large, clip().encode, by_prefix, 512, PREFIX_AXES, 768, False),
    )


def networks(models: dict[str, TextModel], texts: list[str], device: str) -> list[list[Any]]:
    """Rows of each network and precision: rates alone, and how far it is from the CPU's float32."""
    rates = {p: card_rate(device, p) for p in ("float32", "bfloat16")}
    rows: list[list[Any]] = [
        [f"matrix product, {p}", None, None, round(rate, 1), 1.0, None] for p, rate in rates.items()
    ]
    for name, model in models.items():
        ids = model.tokenize(texts)[0]
        some = ids[:: max(1, len(ids) // 256)]
        exact = features_of(*runners(model, {}, "float32", ("torch", "cpu"), 8)[:2], some)
        for precision in rates:
            run, tuned, _ = runners(model, {}, precision, ("torch", device), 8)
            found = features_of(run, tuned, some)
            norms = np.linalg.norm(found, axis=1) * np.linalg.norm(exact, axis=1)
            cosine = float(((found * exact).sum(1) / norms).min())
            begun = time.perf_counter()
            batches = list(tuned.batches(ids, tuned.budget))
            host = time.perf_counter() - begun
            with FlopCounterMode(display=False) as counter:
                for _ in run(batches):
                    pass
            seconds = min(timed(lambda r=run, b=batches: list(r(b)), device) for _ in range(3))
            rate = counter.get_total_flops() / seconds / 1e12
            both = round(len(ids) / seconds), round(len(ids) / host)
            share = round(rate / rates[precision], 3)
            rows.append([f"{name}, {precision}", *both, round(rate, 1), share, f"{cosine:.5f}"])
            print(*rows[-1], f"{len(batches)} batches", flush=True)
    return rows


def commands(
    work: Path, encoder: tuple[str, ...], device: str, workers: list[int]
) -> list[list[Any]]:
    """Whole `rsa-data embed` commands; precision auto is bfloat16 on a GPU that has it."""
    rows = []
    for several in workers:
        words = ["embed", *encoder, "--precision", "auto", "--device", device]
        words += ["--workers", str(several), "--start-over", "--work", str(work)]
        _, wall, _, said = recording.spent([sys.executable, "-m", "rsa_data", *words])
        print(said[-700:], flush=True)
        table = WorkDir(str(work)).table("nyuv2", f"embeddings/release-text/{encoder[1]}")
        count = sum(table.receipt(n).rows for n in table.parts())
        precision = table.description().options["precision"]
        alone = re.search(r"parts? in ([\d.]+) s", said)
        name = f"rsa-data embed, {encoder[1]}, {precision}, workers {several}"
        rows.append(rates(name, count, wall, float(alone[1]) if alone else wall))
    return rows


def peers(folder: Path, texts: list[str], device: str) -> list[list[Any]]:
    """sentence-transformers, a process for each precision and batch size."""
    file, rows = folder / "texts.json", []
    file.write_text(json.dumps(texts))
    for precision, size in (("float32", 32), ("bfloat16", 32), ("bfloat16", 1024)):
        words = {
            "model": str(folder / "minilm"),
            "texts": str(file),
            "device": device,
            "precision": precision,
            "batch": size,
        }
        _, wall, _, said = recording.spent([sys.executable, "-c", _PEER, json.dumps(words)])
        name = f"sentence-transformers, MiniLM, {precision}, batches of {size}"
        rows.append(rates(name, len(texts), wall, float(said.split()[-1])))
    return rows


def rates(name: str, count: int, wall: float, alone: float) -> list[Any]:
    """A row, printed."""
    row = [name, count, round(wall, 1), round(count / wall), round(count / alone)]
    print(*row, flush=True)
    return row


_PEER = """
import json, sys, time, torch
from pathlib import Path
from sentence_transformers import SentenceTransformer
given = json.loads(sys.argv[1])
texts = json.loads(Path(given["texts"]).read_text())
kwargs = {"dtype": getattr(torch, given["precision"])}
model = SentenceTransformer(given["model"], device=given["device"], model_kwargs=kwargs)
begun = time.perf_counter()
model.encode(texts, batch_size=given["batch"])
print(time.perf_counter() - begun)
"""


def prepare(folder: Path, release: Path) -> Path:
    """A work dir with all released captions of NYUv2 train."""
    with tarfile.open(release) as archive:
        archive.extractall(folder / "release", filter="data")
    text = next((folder / "release").rglob("text_all")).parent
    work = folder / "work"
    common = ["--dataset", "nyuv2", "--split", "train", "--work", str(work)]
    for words in (
        ["detect", *common, "--segments", f"rsa-release:{text}"],
        ["captions", *common, "--style", f"release-text:{text}", "--workers", "8"],
    ):
        recording.spent([sys.executable, "-m", "rsa_data", *words])
    return work


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--release", type=Path, required=True)
    parser.add_argument("--minilm", type=Path)
    parser.add_argument("--texts", type=int, default=20_000)
    parser.add_argument("--workers", default="1,4")
    parser.add_argument("--device", choices=("cuda", "cpu"), default="cuda")
    parser.add_argument("--folder", type=Path)
    given = parser.parse_args()
    folder = given.folder or Path(tempfile.mkdtemp(prefix="rsa-data-gpu-"))
    folder.mkdir(exist_ok=True, parents=True)
    models = dict(towers())
    if given.minilm:
        (folder / "minilm").symlink_to(given.minilm.resolve())
        own = given.minilm
        files = {str(p.relative_to(own)): p for p in own.rglob("*") if p.is_file()}
        models["MiniLM"] = sentence.load(files)
    distinct = {line: None for lines in captions(given.release) for line in lines}
    texts = list(distinct)[: given.texts]
    print(
        f"{len(distinct)} distinct texts, {len(texts)} of them for the networks alone", flush=True
    )
    alone = networks(models, texts, given.device)
    begun = time.perf_counter()
    work = prepare(folder, given.release)
    print(f"captions ready after {time.perf_counter() - begun:.1f} s", flush=True)
    weights = folder / "clip.safetensors"
    from safetensors.torch import save_file

    save_file({k: v.contiguous() for k, v in random_tower().state_dict().items()}, weights)
    workers = [int(n) for n in given.workers.split(",")]
    whole = commands(
        work, ("--encoder", "clip-rn50", "--encoder-weights", str(weights)), given.device, workers
    )
    if given.minilm:
        words = ("--encoder", "minilm", "--encoder-weights", str(given.minilm))
        whole += commands(work, words, given.device, workers)
        whole += peers(folder, texts, given.device)
    if given.device == "cpu":
        return
    note = f"{len(texts):,} distinct released captions of NYUv2 train."
    recording.table(
        "gpu",
        "Networks of texts alone on a GPU",
        ("network", "texts/s", "texts/s of making batches", "TFLOP/s", "share of the card's rate",
         "least cosine with float32 on the CPU"),
        alone,
        note=note + " Shares are of a product of two matrices of 8192 x 8192 in that precision, "
        "operations as torch counts them; shared beginnings are computed once and counted once.",
    )  # fmt: skip
    recording.table(
        "gpu",
        "Whole commands on a GPU",
        ("command", "texts", "wall s, whole", "texts/s, whole", "texts/s, work alone"),
        whole,
        note="Released captions of NYUv2 train: all that are distinct within parts, the peer's "
        f"{len(texts):,} of them, for which its start counts more; hence the work alone.",
        packages=("sentence-transformers", "transformers"),
    )


if __name__ == "__main__":
    main()
