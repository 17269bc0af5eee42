"""BERT (Devlin et al., 2018), the network of most sentence encoders, as far as features need it.

Half the code of transformers' and none of its three seconds of imports. Rows beyond a text's length
are computed and never read.
"""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import torch
from torch import nn
from torch.nn import functional as F

from .checkpoints import load_strictly, read_tensors

_Size = Annotated[int, msgspec.Meta(ge=1, le=2**20)]


class Config(msgspec.Struct, frozen=True):
    """What config.json says of a network that this module computes."""

    model_type: Literal["bert"]
    hidden_size: _Size
    num_hidden_layers: _Size
    num_attention_heads: _Size
    intermediate_size: _Size
    vocab_size: _Size
    max_position_embeddings: _Size
    layer_norm_eps: Annotated[float, msgspec.Meta(gt=0, lt=1)]
    hidden_act: Literal["gelu"]
    position_embedding_type: Literal["absolute"] = "absolute"
    is_decoder: Literal[False] = False


def config_of(path: Path) -> Config | None:
    """The configuration, or None when another code has to compute the network."""
    try:
        return msgspec.convert(json.loads(path.read_text("utf-8")), Config)
    except (OSError, ValueError, RecursionError, msgspec.ValidationError):
        return None


class Layer(nn.Module):
    """One post-norm transformer layer; query, key and value weights stand in one matrix."""

    def __init__(self, width: int, heads: int, inner: int, eps: float):
        super().__init__()
        self.heads = heads
        self.qkv, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.up, self.down = nn.Linear(width, inner), nn.Linear(inner, width)
        self.norm_1, self.norm_2 = nn.LayerNorm(width, eps), nn.LayerNorm(width, eps)

    def forward(self, x: torch.Tensor, read: torch.Tensor) -> torch.Tensor:
        """x : (b, t, width). read : bool (b, 1, 1, t). Returns (b, t, width)."""
        qkv = self.qkv(x).unflatten(-1, (3, self.heads, -1))  # (b, t, 3, heads, width / heads)
        q, k, v = qkv.permute(2, 0, 3, 1, 4)  # (b, heads, t, width / heads) each
        y = F.scaled_dot_product_attention(q, k, v, attn_mask=read)
        x = self.norm_1(self.out(y.transpose(1, 2).flatten(2)) + x)  # (b, t, width)
        x = self.norm_2(self.down(F.gelu(self.up(x))) + x)
        return x


class Bert(nn.Module):
    """Token ids to the last layer's rows."""

    def __init__(self, config: Config):
        super().__init__()
        width, eps = config.hidden_size, config.layer_norm_eps
        # Zeros, because drawing random weights that are replaced would take a while.
        zeros = torch.zeros(config.vocab_size, width)
        self.words = nn.Embedding(config.vocab_size, width, _weight=zeros)
        # With the embedding of the one token type that there is.
        self.positions = nn.Parameter(torch.zeros(config.max_position_embeddings, width))
        self.norm = nn.LayerNorm(width, eps)
        self.layers = nn.ModuleList(
            Layer(width, config.num_attention_heads, config.intermediate_size, eps)
            for _ in range(config.num_hidden_layers)
        )

    def forward(self, ids: torch.Tensor, read: torch.Tensor) -> torch.Tensor:
        """ids : int64 (b, t). read : bool (b, t). Returns (b, t, width)."""
        x = self.norm(self.words(ids) + self.positions[: ids.shape[1]])  # (b, t, width)
        for layer in self.layers:
            x = layer(x, read[:, None, None])
        encoded: torch.Tensor = x
        return encoded


# Names in checkpoints -> names here. Attention's three matrices are joined, see `load`.
_NAMES = {
    "embeddings.word_embeddings": "words",
    "embeddings.LayerNorm": "norm",
    "attention.output.dense": "out",
    "attention.output.LayerNorm": "norm_1",
    "intermediate.dense": "up",
    "output.dense": "down",
    "output.LayerNorm": "norm_2",
}


def load(path: Path, config: Config) -> Bert:
    """The network with the weights of a checkpoint, float32.

    Raises RsaDataError when tensors are missing, unknown, of another shape or not finite.
    """
    found = {name.removeprefix("bert."): t.float() for name, t in read_tensors(path).items()}
    tensors: dict[str, Any] = {}
    positions, types = (f"embeddings.{n}_embeddings.weight" for n in ("position", "token_type"))
    if positions in found and types in found:
        tensors["positions"] = found.pop(positions) + found.pop(types)[0]
    for index in range(config.num_hidden_layers):
        for kind in ("weight", "bias"):
            names = [f"encoder.layer.{index}.attention.self.{n}.{kind}" for n in _QKV]
            if all(name in found for name in names):
                tensors[f"layers.{index}.qkv.{kind}"] = torch.cat([found.pop(n) for n in names])
    for name, tensor in found.items():
        # A buffer of old files, and layers that features do not read.
        if not name.startswith(("embeddings.position_ids", "pooler.", "cls.")):
            tensors[_renamed(name)] = tensor
    network = Bert(config).eval()
    load_strictly(network, tensors, path)
    return network


_QKV = ("query", "key", "value")


def _renamed(name: str) -> str:
    place, _, kind = name.rpartition(".")
    if place.startswith("encoder.layer."):
        index, _, inner = place.removeprefix("encoder.layer.").partition(".")
        return f"layers.{index}.{_NAMES.get(inner, inner)}.{kind}"
    return f"{_NAMES.get(place, place)}.{kind}"
