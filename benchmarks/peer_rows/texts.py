"""Text embedding: all-MiniLM-L6-v2 on released captions, and CLIP RN50's text tower."""

import json
import sys
import tarfile
from pathlib import Path
from typing import Any

import numpy as np

from rsa_data.store import schemas
from rsa_data.store.tables import WorkDir

from .ways import Given, Row, Run, Way, cosines, ours, peer, process, stage

_CAPTIONS = "captions/release-text"


def minilm(given: Given) -> Row:
    """`rsa-data embed` (work dir, receipts, audit of bfloat16) against encoders of sentences."""
    work, file, texts = captions(given, 10 if given.small else given.options["images"])
    model = given.options.get("minilm")
    if model is None:
        sys.exit("--minilm DIR: expected all-MiniLM-L6-v2 with onnx/model.onnx; none was given")
    flat = given.folder / "fastembed"
    flat.mkdir(exist_ok=True)
    for path in (*model.glob("*.json"), model / "onnx" / "model.onnx"):
        (flat / path.name).unlink(missing_ok=True)
        (flat / path.name).symlink_to(path.resolve())

    def theirs(way: str, folder: Path) -> Way:
        name = way if way == "fastembed" else f"sentence-transformers, {way}"
        return Way(name, lambda: peer(given, "texts", way=way, model=folder, texts=file))

    def own(precision: str) -> Way:
        words = ("--encoder", "minilm", "--precision", precision)
        return Way(f"rsa-data, {precision}", lambda: embed(given, work, texts, words), ours=True)

    embed(given, work, texts, ("--encoder", "minilm"))  # makes the graph, once and for all
    ways = [theirs("torch", model), theirs("onnx", model), theirs("fastembed", flat)]
    return Row(
        "Text embedding, all-MiniLM-L6-v2",
        len(texts),
        "texts",
        (*ways, own("float32"), own("bfloat16")),
        cosines,
        "Distinct released captions of NYUv2 test images, natural and structured; batches of 32 in "
        "the peers, which sentence-transformers sorts by length.",
    )


def clip(given: Given) -> Row:
    """CLIP RN50's text tower with random weights, which decide nothing about time."""
    work, file, texts = captions(given, 4 if given.small else 20)
    weights = random_clip(given)

    def theirs(way: str) -> Way:
        words = {"way": way, "weights": weights, "texts": file}
        return Way(f"{way}, 77 tokens", lambda: peer(given, "clip", **words))

    def own(precision: str) -> Way:
        words = ("--encoder", "clip-rn50", "--encoder-weights", weights, "--precision", precision)
        return Way(f"rsa-data, {precision}", lambda: embed(given, work, texts, words), ours=True)

    embed(given, work, texts, ("--encoder", "clip-rn50", "--encoder-weights", weights))
    return Row(
        "Text embedding, CLIP RN50",
        len(texts),
        "texts",
        (theirs("open_clip"), theirs("transformers"), own("float32"), own("bfloat16")),
        cosines,
        "Random weights, which time does not depend on; batches of 32 in the peers, padded to 77 "
        "tokens as their tokenizers do.",
    )


def captions(given: Given, images: int) -> tuple[Path, Path, list[str]]:
    """A work dir with released captions, a file of its distinct texts, and the texts.

    images : how many, with 15 lines each; less than 100, or several parts of about 100.
    """
    work, release = given.folder / f"texts-{images}", given.folder / "release"
    if not release.is_dir():
        with tarfile.open(given.shared / "rsa_release" / "nyu-test.tar.xz") as archive:
            archive.extractall(release, filter="data")
    text = next(release.rglob("text_all")).parent
    parts = -(-images // 110)
    cut = ("--dataset-option", f"test_part_size={images // parts}", "--part-range", f"0:{parts}")
    style = ("--style", f"release-text:{text}", "--tokenizer", "minilm")
    common = ("--dataset", "nyuv2", "--split", "test", *cut)
    # The released segments know the samples, so that no images are needed.
    ours(given, work, "detect", *common, "--segments", f"rsa-release:{text}")
    ours(given, work, "captions", *common, *style)
    table = WorkDir(str(work)).table("nyuv2", _CAPTIONS)
    found: dict[str, None] = {}
    for part in table.parts():
        found.update(dict.fromkeys(table.read(part, columns=["text"])["text"].to_pylist()))
    file = given.folder / f"texts-{images}.json"
    file.write_text(json.dumps(list(found)))
    return work, file, list(found)


def embed(given: Given, work: Path, texts: list[str], words: tuple[Any, ...]) -> Run:
    """`rsa-data embed`; features in the order of `texts`."""
    name = words[1]
    table = f"embeddings/release-text/{name}"

    def read() -> np.ndarray:
        opened = WorkDir(str(work))
        made, said = opened.table("nyuv2", table), opened.table("nyuv2", _CAPTIONS)
        features: dict[str, np.ndarray] = {}
        for part in made.parts():
            rows = said.read(part, columns=["text", "text_id"])
            text_of = dict(zip(rows["text_id"].to_pylist(), rows["text"].to_pylist(), strict=True))
            content = made.read(part)
            ids = content["text_id"].to_pylist()
            for text_id, row in zip(ids, schemas.embedding_array(content), strict=True):
                features[text_of[text_id]] = row
        return np.stack([features[text] for text in texts]).astype(np.float32)

    how = ("--store", "float32", "--threads", given.threads, "--start-over")
    how += ("--part-range", f"0:{len(WorkDir(str(work)).table('nyuv2', _CAPTIONS).parts())}")
    return stage(given, work, table, "nyuv2", read, "embed", *words, *how)


def random_clip(given: Given) -> Path:
    """A file of CLIP RN50's tensors by their published names, as open_clip draws them."""
    file = given.folder / "clip-rn50.safetensors"
    if not file.is_file():
        script = Path(__file__).parent / "their_clip.py"
        process(given, [given.python, str(script), json.dumps({"make": str(file)})])
    return file
