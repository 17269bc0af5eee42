"""Sentence encoders from a folder in the layout of sentence-transformers, and MiniLM as one.

What the folder says is what is computed; see common/sentence_folders.py.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..common import minilm
from ..common.errors import RsaDataError
from ..common.pretrained import folder_files, load_model
from ..common.sentence_folders import Layout, applied, layout
from .batches import LENGTH_AXES, by_length
from .encoder import Encoder, Ids, TextModel


def load(files: dict[str, Path]) -> TextModel:
    """The encoder of the files that `pretrained.folder_files` names.

    Raises RsaDataError when the folder lacks a file, or asks for what is not computed here.
    """
    said = layout(files)
    return TextModel(
        network=lambda: _module(files, said),
        tokenize=_tokenize(files["tokenizer.json"], said),
        batches=by_length,
        budget=1024,
        axes=LENGTH_AXES,
        dim=said.width,
        normalized=said.normalized,
    )


def _tokenize(path: Path, said: Layout) -> Any:
    from tokenizers import Tokenizer

    try:
        tokenizer = Tokenizer.from_file(str(path))
    except Exception as error:  # tokenizers' errors have no common base but Exception
        raise RsaDataError(f"{path}: expected a tokenizer: {error}") from error
    tokenizer.no_padding()
    tokenizer.enable_truncation(said.max_tokens, direction=said.cut)

    def encode(texts: list[str]) -> tuple[Ids, np.ndarray]:
        texts = [(said.prompt + text).strip() for text in texts]
        found = tokenizer.encode_batch_fast([t.lower() for t in texts] if said.lower else texts)
        return [one.ids for one in found], np.array([bool(one.overflowing) for one in found], bool)

    return encode


def _network(files: dict[str, Path]) -> Any:
    """A network (ids, read) -> rows of shape (b, t, dim)."""
    from . import bert

    config = bert.config_of(files["config.json"])
    if config is not None and "model.safetensors" in files:
        return bert.load(files["model.safetensors"], config)
    import torch
    from transformers import AutoModel

    model = load_model(AutoModel, files["config.json"].parent, whole=True)

    class Rows(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.model = model

        def forward(self, ids: torch.Tensor, read: torch.Tensor) -> torch.Tensor:
            found = self.model(input_ids=ids, attention_mask=read.long())
            rows: torch.Tensor = found.last_hidden_state  # (b, t, dim)
            return rows

    return Rows()


def _module(files: dict[str, Path], said: Layout) -> Any:
    import torch
    from torch.nn import functional as F

    network = _network(files)

    class SentenceEncoder(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.model = network

        def forward(self, ids: torch.Tensor, lengths: torch.Tensor) -> torch.Tensor:
            read = torch.arange(ids.shape[1], device=ids.device) < lengths[:, None]  # (b, t)
            rows = self.model(ids, read).float()  # (b, t, dim)
            if said.pooling == "cls":
                rows = rows[:, 0]  # (b, dim)
            elif said.pooling == "max":
                rows = rows.masked_fill(~read[..., None], float("-inf")).amax(1)  # (b, dim)
            else:
                rows = (rows * read[..., None]).sum(1) / lengths[:, None]  # (b, dim)
            return F.normalize(rows, dim=-1) if said.normalized else rows

    return SentenceEncoder().eval()


def _minilm_files(argument: str | None, weights: Path | None) -> dict[str, Path]:
    if weights is not None:
        files = folder_files(weights)
        return {**files, **applied(files)}
    return folder_files(minilm.folder_with("model.safetensors"))


def _load_minilm(files: dict[str, Path]) -> TextModel:
    return replace(load(files), no_int8=_NO_INT8)


# Measured on released captions, one thread of an AMD EPYC with avx512_vnni and avx512_bf16. Left in
# float32 were, in turn, attention; the first and last layer; all but the MLP; all but its inputs
# and the attention's: the cosine rose to .9959 at most, and the speed fell to that of bfloat16.
_NO_INT8 = (
    "all-MiniLM-L6-v2 in int8 is 1.4 times as fast as in bfloat16, but its cosine with float32 "
    "falls to .992, where .995 is the least that the comparison with float32 lets pass"
)

MINILM: Encoder[TextModel] = Encoder(
    "all-MiniLM-L6-v2, 384-d, normalised: from the extra `offline` or the Hugging Face cache.",
    _minilm_files,
    _load_minilm,
)
