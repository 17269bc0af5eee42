"""CLIP RN50, the paper's encoder: its published weights in any of their forms."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..common.errors import RsaDataError
from ..common.model_files import fetch
from .batches import PREFIX_AXES, by_prefix
from .checkpoints import load_strictly, read_tensors
from .encoder import Encoder, ImageModel, TextModel
from .prepare import CLIP_RN50 as CLIP_RN50_PIXELS
from .prepare import preparer

if TYPE_CHECKING:
    from .clip_image import ImageTower
    from .clip_text import TextTower

# What a whole CLIP checkpoint holds; the text tower is all the rest.
_IMAGE = "visual."
_NOT_TEXT = (_IMAGE, "logit_scale", "logit_bias")
_SCALARS = ("input_resolution", "context_length", "vocab_size")
# The causal mask, a constant that TorchScript archives may carry in every block.
_MASK = "attn_mask"


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
        if not name.startswith(_NOT_TEXT) and name not in _SCALARS and not name.endswith(_MASK)
    }
    if not text:
        raise RsaDataError(f"{path}: expected CLIP's text tower; found other tensors only")
    tower = TextTower(**sizes).eval()
    load_strictly(tower, text, path)
    return tower


def read_image_tower(path: Path, **sizes: Any) -> "ImageTower":
    """CLIP's image tower with the weights of a checkpoint of a whole CLIP model.

    sizes : arguments of ImageTower; without them those of CLIP RN50.

    Raises RsaDataError as read_text_tower does.
    """
    from .clip_image import ImageTower

    tensors = read_tensors(path)
    image = {n.removeprefix(_IMAGE): t for n, t in tensors.items() if n.startswith(_IMAGE)}
    if not image:
        raise RsaDataError(f"{path}: expected a whole CLIP model; found no image tower (visual.)")
    tower = ImageTower(**sizes).eval()
    load_strictly(tower, image, path)
    return tower


def _files(argument: str | None, weights: Path | None) -> dict[str, Path]:
    return {"weights": weights or fetch("clip-rn50")}


def _load(files: dict[str, Path]) -> TextModel:
    from ..common.tokenizers import clip

    return TextModel(
        network=lambda: read_text_tower(files["weights"]),
        tokenize=clip().encode,
        batches=by_prefix,
        budget=512,
        axes=PREFIX_AXES,
        dim=1024,
        normalized=False,
    )


def _load_image(files: dict[str, Path]) -> ImageModel:
    import torch

    tower = read_image_tower(files["weights"])
    # On CPUs a quarter faster than with the channels before the rows. torch's stubs lack this form.
    tower.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    return ImageModel(
        module=tower,
        prepare=preparer(CLIP_RN50_PIXELS, "clip-rn50"),
        dim=1024,
    )


CLIP_RN50: Encoder[TextModel] = Encoder(
    "CLIP RN50's text tower, 1024-d, the paper's: downloaded, or --encoder-weights FILE.",
    _files,
    _load,
)
CLIP_RN50_IMAGE: Encoder[ImageModel] = Encoder(
    "CLIP RN50's image tower, 1024-d: downloaded, or --encoder-weights FILE.", _files, _load_image
)
