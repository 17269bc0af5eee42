"""Any text encoder of the Hugging Face hub, or of a folder: `hf:NAME_OR_DIR`.

How features are pooled and whether they are normalised is taken from the model: CLIP's projection
of the end token, SigLIP's pooled output, and for everything else the steps that sentence-
transformers wrote into modules.json.
"""

import json
from pathlib import Path
from typing import Any

from ..common.errors import RsaDataError, UsageError
from ..common.pretrained import folder_files, folder_of, load_model, tokenize_with
from ..common.sentence_folders import applied
from . import sentence
from .batches import LENGTH_AXES, by_length
from .encoder import Encoder, TextModel


def named_files(argument: str | None, weights: Path | None) -> dict[str, Path]:
    """The files of the model `hf:ARGUMENT`, or of the folder `weights`."""
    if argument is None and weights is None:
        raise UsageError(
            "encoder hf: expected hf:NAME_OR_DIR, or the model's folder by --encoder-weights"
        )
    files = folder_files(folder_of(argument or "", weights))
    return {**files, **applied(files)}


def load(files: dict[str, Path]) -> TextModel:
    """The text encoder of a model's folder.

    Raises RsaDataError for models that are not CLIP, SigLIP or a sentence encoder: how their
    features are to be pooled stands nowhere.
    """
    if "modules.json" in files:
        return sentence.load(files)
    folder = files["config.json"].parent
    try:
        config = json.loads(files["config.json"].read_text("utf-8"))
        kind = str(config["model_type"])
    except (ValueError, KeyError, TypeError) as error:
        raise RsaDataError(f"{folder}/config.json: expected a model's configuration") from error
    if kind in ("clip", "clip_text_model"):
        from transformers import CLIPTextModelWithProjection

        model, fill, output = load_model(CLIPTextModelWithProjection, folder), False, "text_embeds"
    elif kind in ("siglip", "siglip_text_model"):
        from transformers import SiglipTextModel

        # SigLIP was trained with every text filled up to the end, and reads the filling.
        model, fill, output = load_model(SiglipTextModel, folder), True, "pooler_output"
    else:
        raise RsaDataError(
            f"{folder}: expected a CLIP or SigLIP model, or a sentence encoder with modules.json; "
            f"found {kind!r}: how its features are pooled is not stated"
        )
    max_tokens = int(model.config.max_position_embeddings)
    return TextModel(
        network=lambda: _module(model, output),
        tokenize=tokenize_with(folder, max_tokens, fill),
        batches=by_length,
        budget=1024,
        axes=LENGTH_AXES,
        dim=_dim(model, output),
        normalized=False,
    )


def _dim(model: Any, output: str) -> int:
    if output == "text_embeds":
        return int(model.config.projection_dim)
    return int(getattr(model.config, "projection_size", None) or model.config.hidden_size)


def _module(model: Any, output: str) -> Any:
    import torch

    class TextFeatures(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.model = model

        def forward(self, ids: torch.Tensor, lengths: torch.Tensor) -> torch.Tensor:
            # CLIP is causal and finds the end token by itself, SigLIP's texts are all of one
            # length: neither needs to know where the padding begins.
            features: torch.Tensor = getattr(self.model(input_ids=ids), output)  # (b, dim)
            return features

    return TextFeatures().eval()


HF: Encoder[TextModel] = Encoder(
    "hf:NAME_OR_DIR: a CLIP, SigLIP or sentence encoder of the Hugging Face hub or a folder.",
    named_files,
    load,
)
