"""Tiny encoders with random weights, and the tables that they read."""

import hashlib

import pyarrow as pa
import torch

from rsa_data.common.tokenizers import clip
from rsa_data.embeddings.batches import PREFIX_AXES, by_prefix
from rsa_data.embeddings.clip_text import TextTower
from rsa_data.embeddings.encoder import Encoder, TextModel
from rsa_data.store import schemas


def captions(texts: list[str]) -> pa.Table:
    """A captions part with one row a text, three rows a sample."""
    n = len(texts)
    return schemas.from_columns(
        "captions",
        {
            "sample_id": [f"d/train/{i // 3}" for i in range(n)],
            "variant": [i % 3 for i in range(n)],
            "text": texts,
            "text_id": [hashlib.blake2b(t.encode(), digest_size=16).digest() for t in texts],
            "n_objects": [1] * n,
            "n_kept": [1] * n,
            "n_tokens": [1] * n,
            "area": [1.0] * n,
            "area_kept": [1.0] * n,
        },
    )


def samples(paths: list[str | None]) -> pa.Table:
    n = len(paths)
    none = [None] * n
    return schemas.from_columns(
        "samples",
        {
            "sample_id": [f"d/train/{i}" for i in range(n)],
            "dataset": ["d"] * n,
            "split": ["train"] * n,
            "scene": ["s"] * n,
            "image": paths,
            **dict.fromkeys(("depth", "width", "height", "fx", "fy", "cx", "cy"), none),
        },
    )


SIGHT = {
    "hidden_size": 32,
    "intermediate_size": 64,
    "num_hidden_layers": 1,
    "num_attention_heads": 2,
    "image_size": 32,
    "patch_size": 16,
}


def randomize(model):
    torch.manual_seed(0)
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(torch.randn_like(parameter) * 0.2)
    return model.eval()


def load(files, seed: int = 0) -> TextModel:
    """A tiny CLIP text encoder with random weights and CLIP's own tokenizer."""
    torch.manual_seed(seed)
    tower = TextTower(width=128, heads=2, layers=2, dim=32).eval()
    with torch.no_grad():
        for name, parameter in tower.named_parameters():
            scale = 1.0 if "ln_" in name and "weight" in name else 0.0
            parameter.normal_(scale, 0.1 if "embedding" in name else 0.05)
    return TextModel(lambda: tower, clip().encode, by_prefix, 64, PREFIX_AXES, 32, False)


TINY = Encoder("A tiny CLIP.", lambda argument, weights: {}, load)
OTHER = Encoder("Another.", lambda argument, weights: {}, lambda files: load(files, seed=1))
