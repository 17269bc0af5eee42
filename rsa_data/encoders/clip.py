"""CLIP RN50's text encoder, the paper's: its published weights in any of their forms."""

from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import RsaDataError
from ..models import fetch
from . import TextEncoder, TextModel
from .batches import PREFIX_AXES, by_prefix
from .checkpoints import load_strictly, read_tensors

if TYPE_CHECKING:
    from .clip_text import TextTower

# What else a whole CLIP checkpoint holds; the text tower is all the rest.
_NOT_TEXT = ("visual.", "logit_scale", "logit_bias")
_SCALARS = ("input_resolution", "context_length", "vocab_size")


def read_text_tower(path: Path, **sizes: int) -> "TextTower":
    """CLIP's text tower with the weights of a checkpoint, whole CLIP models included.

    sizes : arguments of TextTower; without them those of CLIP RN50.

    Raises RsaDataError when the file is damaged, holds code, or another architecture.
    """
    from .clip_text import TextTower

    tensors = read_tensors(path)
    text = {
        name: tensor
        for name, tensor in tensors.items()
        if not name.startswith(_NOT_TEXT) and name not in _SCALARS
    }
    if not text:
        raise RsaDataError(f"{path}: expected CLIP's text tower; found other tensors only")
    tower = TextTower(**sizes).eval()
    load_strictly(tower, text, path)
    return tower


def _files(argument: str | None, weights: Path | None) -> dict[str, Path]:
    return {"weights": weights or fetch("clip-rn50")}


def _load(files: dict[str, Path]) -> TextModel:
    from .tokenizers import clip

    return TextModel(
        module=read_text_tower(files["weights"]),
        tokenize=clip().encode,
        batches=by_prefix,
        budget=512,
        axes=PREFIX_AXES,
        dim=1024,
        normalized=False,
    )


CLIP_RN50 = TextEncoder(_files, _load)
