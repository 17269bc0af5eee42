"""Folders of Hugging Face models, and the values of options."""

import json
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from PIL import Image

from rsa_data import registry
from rsa_data.captions import vlm
from rsa_data.common import pretrained, tokenizers, units
from rsa_data.common.errors import RsaDataError
from rsa_data.datasets.folder import folder
from rsa_data.depth import onnx
from rsa_data.embeddings import sentence
from rsa_data.heads.predict import camera, correction, known_depth
from rsa_data.runner import limits

from .forms import (
    Importer,
    One,
    is_text,
    js,
    list_seeds,
    put,
)


def vocabulary() -> dict[str, Any]:
    from tokenizers import Tokenizer, pre_tokenizers, processors
    from tokenizers import models as kinds

    words = {w: i for i, w in enumerate(["[UNK]", "[CLS]", "[SEP]", "a", "bed", "##s"])}
    made = Tokenizer(kinds.WordPiece(words, unk_token="[UNK]"))
    made.pre_tokenizer = pre_tokenizers.Whitespace()
    ends = [("[CLS]", 1), ("[SEP]", 2)]
    made.post_processor = processors.TemplateProcessing("[CLS] $A [SEP]", None, ends)
    return json.loads(made.to_str())


FOLDER = ("tokenizer.json", "config.json", "sentence_bert_config.json", "modules.json")
FOLDER += ("1_Pooling/config.json",)


def model_seeds() -> list[bytes]:
    config = {"model_type": "bert", "max_position_embeddings": 512, "hidden_size": 8}
    files = {"tokenizer.json": vocabulary(), "config.json": config}
    steps = [{"type": f"sentence_transformers.models.{n}"} for n in ("Transformer", "Pooling")]
    more = {"modules.json": steps, "sentence_bert_config.json": {"max_seq_length": 128}}
    more |= {"1_Pooling/config.json": {"pooling_mode_mean_tokens": True, "x": 1}}
    return [js(files), js({**files, **more})]


def model_folder(here: Path) -> One:
    """A Hugging Face folder: what we read of it. Its weights are read by transformers."""
    (here / "model.safetensors").touch()

    def one(data: bytes) -> None:
        put(here, data, FOLDER)
        try:
            made = tokenizers.hf.__wrapped__(str(here))
            made.encode(["a bed", "", "a \u00e9"])
        except RsaDataError:
            pass
        with patch.object(sentence, "_module", lambda *_: None):
            try:
                sentence.load(pretrained.folder_files(here))
            except AttributeError as error:  # the stand-in for the module has no dim
                if "'dim'" not in str(error):
                    raise

    return one


def argument(here: Path) -> One:
    y = np.linspace(0.1, 4, 48, dtype=np.float32).reshape(6, 8)

    def known(text: str) -> None:
        at, metres = known_depth.points(y, [text])
        assert np.isfinite(correction.refine(0.1, 0.1, at, metres)).all()

    def ends(text: str) -> None:
        assert np.isfinite(correction.refine(0.1, 0.1, *known_depth.ends(y, text))).all()

    def known_camera(text: str) -> None:
        camera.camera_of(None, 4, 3, camera.View(intrinsics=text))

    def tokenizer(text: str) -> None:
        registry.build("tokenizer", registry.TOKENIZERS, text)

    readers = [limits.parse_failures, vlm.parse_prices, known, ends, known_camera, onnx.fixed,
               lambda t: units.parse_size(t, "x"), lambda t: folder(depth="d", depth_unit=t),
               lambda t: folder(intrinsics=t).index(here, None), tokenizer]  # fmt: skip
    Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(here / "a.png")

    def one(data: bytes) -> None:
        if not is_text(data):
            return
        for read in readers:
            try:
                read(data.decode())
            except RsaDataError:
                continue

    return one


IMPORTERS = {
    "model-folder": Importer(model_seeds, model_folder),
    "arguments": Importer(
        list_seeds(
            "3,2,1.5",
            "0.5,9",
            "5%",
            "0.05",
            "100",
            "0.15,0.60",
            "m/5000",
            "mm",
            "4GB",
            "560x434",
            "585,585,320,240",
            "hf:a",
            "clip",
        ),
        argument,
        "text",
    ),
}
