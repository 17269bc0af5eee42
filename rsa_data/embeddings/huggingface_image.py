"""Any vision encoder of the Hugging Face hub, or of a folder: `hf:NAME_OR_DIR`, for images."""

import json
from pathlib import Path
from typing import Any

from ..common.errors import RsaDataError
from ..common.pretrained import load_model
from .encoder import Encoder, ImageModel
from .huggingface import named_files
from .prepare import preparer


def load(files: dict[str, Path]) -> ImageModel:
    """The image encoder of a model's folder: CLIP's projection, or the model's pooled output.

    Raises RsaDataError when the folder does not say how images are prepared, or the model has no
    pooled output.
    """
    import torch
    import transformers

    folder = files["config.json"].parent
    kind = _json(files["config.json"]).get("model_type")
    if kind in ("clip", "clip_vision_model"):
        model = load_model(transformers.CLIPVisionModelWithProjection, folder)
        output, dim = "image_embeds", int(model.config.projection_dim)
    else:
        name = "SiglipVisionModel" if kind in ("siglip", "siglip_vision_model") else "AutoModel"
        model = load_model(getattr(transformers, name), folder)
        output, dim = "pooler_output", int(getattr(model.config, "hidden_size", 0))
    if "preprocessor_config.json" not in files:
        raise RsaDataError(
            f"{folder}: expected preprocessor_config.json, to know the pixels wanted"
        )
    settings = _json(files["preprocessor_config.json"])

    class ImageFeatures(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.model = model

        def forward(self, pixels: torch.Tensor) -> torch.Tensor:
            found = self.model(pixel_values=pixels)
            features: torch.Tensor | None = getattr(found, output, None)  # (b, dim)
            if features is None:
                raise RsaDataError(f"{folder}: {kind}: expected a model with a pooled output")
            return features

    prepare = preparer(settings, f"{folder}/preprocessor_config.json")
    return ImageModel(ImageFeatures().eval(), prepare, dim)


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text("utf-8"))
    except ValueError as error:
        raise RsaDataError(f"{path}: expected JSON: {error}") from error


HF_IMAGE: Encoder[ImageModel] = Encoder(
    "hf:NAME_OR_DIR: a vision encoder of the Hugging Face hub or a folder.", named_files, load
)
