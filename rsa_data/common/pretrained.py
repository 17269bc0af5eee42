"""Models and tokenizers from folders of transformers: local files, safetensors, nothing missing."""

import logging
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from .errors import RsaDataError
from .forms import is_path

Ids = Sequence[Sequence[int]]
"""Tokens of each text, start and end included, cut at what the encoder reads."""

# What a folder may hold that decides features. Pickled weights (.bin, .pt) are not among them, and
# neither is code.
_PATTERNS = ("*.json", "*.safetensors", "*.txt", "*.model")

# Names of weights inside a numbered layer.
_LAYER = re.compile(r"\blayers?\.\d+\.")


def folder_of(name: str, weights: Path | None) -> Path:
    """The folder of a model: `weights`, or `name` as a folder, or `name` from the hub or its cache.

    Raises RsaDataError when it cannot be had.
    """
    folder = weights or Path(name).expanduser()
    if is_path(str(folder)) and folder.is_dir():
        return folder
    if weights is not None or name.startswith((".", "/", "~")):
        raise RsaDataError(f"expected a model's folder; there is none at {folder}")
    from huggingface_hub import snapshot_download

    patterns = [*_PATTERNS, *(f"*/{pattern}" for pattern in _PATTERNS[:2])]
    try:
        return Path(snapshot_download(name, allow_patterns=patterns))
    # Hub and network libraries raise errors of many kinds.
    except Exception as error:
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        raise RsaDataError(
            f"hf:{name}: expected a folder or a model on the Hugging Face hub: {reason}. Without a "
            "network: download it elsewhere and name its folder, hf:DIR"
        ) from error


def folder_files(folder: Path) -> dict[str, Path]:
    """The files of a model's folder that decide its features, by relative name.

    Raises RsaDataError when it has no configuration or no weights as safetensors.
    """
    found = {path for pattern in _PATTERNS for path in folder.glob(pattern)}
    found |= {path for pattern in _PATTERNS[:2] for path in folder.glob(f"[0-9]_*/{pattern}")}
    names = {path.relative_to(folder).as_posix(): path for path in sorted(found)}
    if "config.json" not in names:
        raise RsaDataError(f"{folder}: expected a model with a config.json; found none")
    if not any(name.endswith(".safetensors") for name in names):
        raise RsaDataError(
            f"{folder}: expected weights as .safetensors; found none. Pickled weights (.bin, .pt) "
            "are not read, since they can run code"
        )
    return names


def load_model(kind: Any, folder: Path, *, whole: bool = False) -> Any:
    """An instance of a transformers class with all its weights, float32.

    whole : also refuse weights of layers that this transformers does not compute.
    Raises RsaDataError when the folder holds another architecture or its weights are damaged:
    transformers itself would fill what is missing with random numbers and only warn. Code that a
    folder brings is never run.
    """
    import torch

    with _quiet():
        try:
            model, report = kind.from_pretrained(
                str(folder),
                local_files_only=True,
                use_safetensors=True,
                trust_remote_code=False,
                dtype=torch.float32,
                output_loading_info=True,
            )
        # Damaged files and odd configurations surface as errors of many kinds.
        except Exception as error:
            raise RsaDataError(f"{folder}: the model cannot be loaded: {_reason(error)}") from error
    wrong = sorted(map(str, {*report["missing_keys"], *report["mismatched_keys"]}))
    if wrong:
        raise RsaDataError(
            f"{folder}: expected the weights of {kind.__name__}: {wrong[0]} is missing or of "
            f"another shape{f', and {len(wrong) - 1} more' if len(wrong) > 1 else ''}"
        )
    # Heads for other tasks are left over, as they should be; a layer's weights are not.
    over = [name for name in map(str, report["unexpected_keys"]) if _LAYER.search(name)]
    if whole and over:
        raise RsaDataError(
            f"{folder}: expected an architecture that this transformers computes; the weights "
            f"{min(over)} have no use in it"
        )
    for name, parameter in model.named_parameters():
        if not torch.isfinite(parameter).all():
            raise RsaDataError(f"{folder}: damaged: {name} holds values that are not finite")
    return model.eval()


def tokenize_with(
    folder: Path, max_tokens: int, fill: bool = False
) -> Callable[[list[str]], tuple[Ids, np.ndarray]]:
    """The tokenizer of a model's folder, as TextModel.tokenize.

    fill : pad every text to max_tokens, for models that read their padding.
    """
    from transformers import AutoTokenizer

    with _quiet():
        try:
            tokenizer = AutoTokenizer.from_pretrained(
                str(folder), local_files_only=True, trust_remote_code=False
            )
        except Exception as error:
            raise RsaDataError(
                f"{folder}: the tokenizer cannot be loaded: {_reason(error)}"
            ) from error
    padding = "max_length" if fill else False

    def encode(texts: list[str]) -> tuple[Ids, np.ndarray]:
        if not texts:
            return [], np.zeros(0, bool)
        with _quiet():
            # Twice, because how a tokenizer cuts is its own affair, and whether it did is not told.
            whole = tokenizer(texts)["input_ids"]
            ids = tokenizer(texts, truncation=True, max_length=max_tokens, padding=padding)
        return ids["input_ids"], np.array([len(row) > max_tokens for row in whole], bool)

    return encode


def _reason(error: Exception) -> str:
    """What transformers says, in one line."""
    said = " ".join(str(error).split())
    if "trust_remote_code" in said:
        return "it brings code of its own, which is never run"
    return said[:300] or type(error).__name__


@contextmanager
def _quiet() -> Iterator[None]:
    """Silences transformers' reports and bars; what is wrong is raised here."""
    import transformers

    theirs: Any = transformers.utils.logging
    theirs.disable_progress_bar()
    logger = logging.getLogger("transformers")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)
