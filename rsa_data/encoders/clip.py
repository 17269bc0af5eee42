"""CLIP RN50's text encoder, the paper's: its published weights in any of their forms."""

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import RsaDataError
from . import TextEncoder, TextModel
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


# timm's copy of OpenAI's weights on the Hugging Face hub, 408,291,932 bytes, float32.
_REPOSITORY = "timm/resnet50_clip.openai"
_REVISION = "ec3d92cf63a5f9d591f0d611b736895966c73076"
_FILE = "open_clip_model.safetensors"
_SHA256 = "da0baa37fb2211eee5729ab69ed587eb10d48f5b7076ceeed01552fc3d4cb4ee"


def _files(argument: str | None, weights: Path | None) -> dict[str, Path]:
    return {"weights": weights or _download()}


def _download() -> Path:
    from huggingface_hub import hf_hub_download

    way_out = (
        f"Download {_FILE} of https://huggingface.co/{_REPOSITORY} (revision {_REVISION[:8]}) on "
        "another machine and pass it with --weights; OpenAI's RN50.pt does as well"
    )
    try:
        path = Path(hf_hub_download(_REPOSITORY, _FILE, revision=_REVISION))
    # Offline, a proxy, a missing file: hub and network libraries raise errors of many kinds.
    except Exception as error:
        reason = str(error).strip().partition("\n")[0]
        raise RsaDataError(f"clip-rn50: the weights cannot be had: {reason}. {way_out}") from error
    with path.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    if found != _SHA256:
        raise RsaDataError(
            f"{path}: expected sha256 {_SHA256}, found {found}: delete it and try again. {way_out}"
        )
    return path


def _load(files: dict[str, Path]) -> TextModel:
    from .tokenizers import clip

    return TextModel(read_text_tower(files["weights"]), clip().encode, dim=1024, normalized=False)


CLIP_RN50 = TextEncoder(_files, _load)
