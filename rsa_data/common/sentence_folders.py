"""What a folder in the layout of sentence-transformers says: every key with an effect is applied or
refused, so that features are those of its `encode`, or none.

Sources: sentence-transformers 5.1 and 6.2, `models/Transformer.py`, `models/Pooling.py` and
`SentenceTransformer.encode`; transformers, `BertTokenizerFast.__init__`.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from . import forms
from .errors import RsaDataError

NEEDED = ("config.json", "modules.json", "tokenizer.json", "1_Pooling/config.json")

_SENTENCE, _PROMPTS = "sentence_bert_config.json", "config_sentence_transformers.json"

# Keys of sentence_bert_config.json that are applied here, or that change nothing.
_READ = ("max_seq_length", "do_lower_case", "unpad_inputs")
# What those of version 6 must be, where they stand.
_AS_EVER = {
    "transformer_task": "feature-extraction",
    "modality_config": {"text": {"method": "forward", "method_output_name": "last_hidden_state"}},
    "module_output_name": "token_embeddings",
}
_POOLINGS = {"mean_tokens": "mean", "cls_token": "cls", "max_tokens": "max"}

# Networks with a table of positions, and those of them that count from behind the padding token.
_FROM_PADDING = ("roberta", "xlm-roberta", "xlm-roberta-xl", "camembert", "mpnet", "xmod")
_TABLE = ("bert", "distilbert", "albert", "electra", "mobilebert", *_FROM_PADDING)

# Tokenizers whose classes take these settings from tokenizer_config.json, and their defaults.
_BERTS = ("Bert", "DistilBert", "Electra", "MPNet", "MobileBert")
_SETTINGS = {
    "lowercase": ("do_lower_case", True),
    "strip_accents": ("strip_accents", None),
    "handle_chinese_chars": ("tokenize_chinese_chars", True),
}


@dataclass(frozen=True)
class Layout:
    """pooling : of the rows of all tokens. normalized : whether features have norm 1.

    width : of a row. max_tokens : read of a text, start and end included. cut : the side at which a
    longer one loses tokens. prompt : stands before every text. lower : texts are lower-cased.
    """

    pooling: Literal["mean", "cls", "max"]
    normalized: bool
    width: int
    max_tokens: int
    cut: Literal["left", "right"]
    prompt: str
    lower: bool


def layout(files: Mapping[str, Path]) -> Layout:
    """What the files of a folder say, by their relative names.

    Raises RsaDataError for a file that is missing, and for what is not computed here.
    """
    folder = files["config.json"].parent
    if missing := [name for name in NEEDED if name not in files]:
        raise RsaDataError(
            f"{folder}: expected a sentence encoder in the layout of sentence-transformers; "
            f"{missing[0]} is not there"
        )
    normalized = _steps(files["modules.json"])
    said, prompt = _settings(files.get(_SENTENCE)), _prompt(files.get(_PROMPTS))
    pooling = _pooling(files["1_Pooling/config.json"], prompt)
    config, tokens = _object(files["config.json"]), _object(files.get("tokenizer_config.json"))
    _check_normalizer(files["tokenizer.json"], tokens)
    width = next((config[k] for k in ("hidden_size", "dim", "d_model") if k in config), None)
    cut = tokens.get("truncation_side", "right")
    forms.check(cut, "text", f"{folder}/tokenizer_config.json.truncation_side")
    return Layout(
        pooling=pooling,
        normalized=normalized,
        width=forms.check(width, "a side in px", f"{files['config.json']}.hidden_size"),
        max_tokens=max_tokens(folder),
        cut="left" if cut == "left" else "right",
        prompt=prompt,
        lower=bool(said.get("do_lower_case")),
    )


def applied(files: Mapping[str, Path]) -> dict[str, Path]:
    """Files whose settings older versions did not follow, by names that say what is followed now.

    They stand among the files of a table, so that one with other features is not continued.
    Raises RsaDataError as `layout` does; {} for a folder of another layout.
    """
    if "modules.json" not in files:
        return {}
    said, found = layout(files), {}
    if said.prompt:
        found["prompt applied"] = files[_PROMPTS]
    if said.lower:
        found["lower case applied"] = files[_SENTENCE]
    if said.cut == "left":
        found["left side cut"] = files["tokenizer_config.json"]
    return found


def max_tokens(folder: Path) -> int:
    """The most tokens of a text that the model of a folder reads, start and end included.

    What sentence_bert_config.json says, else the tokenizer's limit; never more than there are
    positions, where they stand in a table. Raises RsaDataError when nothing says it.
    """
    config = _object(folder / "config.json")
    limits = []
    if (said := _object(folder / _SENTENCE).get("max_seq_length")) is not None:
        limits.append(forms.check(said, "a side in px", f"{folder / _SENTENCE}.max_seq_length"))
    else:
        # Tokenizers without a limit write 1e30.
        own = _object(folder / "tokenizer_config.json").get("model_max_length")
        limits += [own] if isinstance(own, int) and 0 < own < 2**20 else []
    positions = config.get("max_position_embeddings")
    kind = config.get("model_type")
    if isinstance(positions, int) and (kind in _TABLE or not limits):
        padding = config.get("pad_token_id")
        behind = (1 if padding is None else padding) + 1 if kind in _FROM_PADDING else 0
        limits.append(positions - behind)
    if not limits:
        raise RsaDataError(
            f"{folder}: expected max_seq_length in {_SENTENCE}, or max_position_embeddings in "
            "config.json: the tokens that the model reads; found neither"
        )
    return int(min(limits))


def _object(path: Path | None) -> dict[str, Any]:
    if path is None or not path.is_file():
        return {}
    try:
        found: dict[str, Any] = forms.check(
            json.loads(path.read_text("utf-8")), "an object", str(path)
        )
        return found
    except (OSError, ValueError, RecursionError) as error:
        raise RsaDataError(f"{path}: expected JSON: {error}") from error


def _steps(path: Path) -> bool:
    """Whether the steps end with a normalisation."""
    try:
        modules = forms.check(json.loads(path.read_text("utf-8")), [{"type": "text"}], str(path))
    except (OSError, ValueError, RecursionError) as error:
        raise RsaDataError(f"{path}: expected JSON: {error}") from error
    kinds = [module["type"] for module in modules]
    steps = [kind.rsplit(".", 1)[-1] for kind in kinds]
    own = [kind for kind in kinds if not kind.startswith("sentence_transformers.")]
    if own:
        raise RsaDataError(
            f"{path}: expected modules of sentence-transformers; found {own[0]}, code of the "
            "model's own, which is never run"
        )
    if steps not in (["Transformer", "Pooling"], ["Transformer", "Pooling", "Normalize"]):
        raise RsaDataError(
            f"{path}: expected a transformer, pooling and perhaps normalisation; "
            f"found {', '.join(steps)}"
        )
    places = [m.get("path", usual) for m, usual in zip(modules, ("", "1_Pooling"), strict=False)]
    if places != ["", "1_Pooling"]:
        raise RsaDataError(
            f"{path}: expected the transformer in the folder itself and the pooling in 1_Pooling; "
            f"found {places[0]!r} and {places[1]!r}"
        )
    return len(steps) == 3


def _settings(path: Path | None) -> dict[str, Any]:
    """sentence_bert_config.json."""
    found = _object(path)
    for key, value in found.items():
        if key not in _READ and value not in (None, {}, [], "", False, _AS_EVER.get(key)):
            raise RsaDataError(
                f"{path}: {key}: expected nothing that changes features; found "
                f"{forms.found(value)}, which is not applied here"
            )
    return found


def _prompt(path: Path | None) -> str:
    """What `encode` puts before a text unless it is told otherwise."""
    found = _object(path)
    if found.get("truncate_dim") is not None:
        raise RsaDataError(f"{path}: truncate_dim: features are not cut here: expected none")
    name = found.get("default_prompt_name")
    if name is None:
        return ""
    prompts = found.get("prompts")
    prompt = prompts.get(name) if isinstance(prompts, dict) else None
    if not isinstance(prompt, str):
        raise RsaDataError(f"{path}: expected the prompt {name!r} that it names; found none")
    return prompt


def _pooling(path: Path, prompt: str) -> Literal["mean", "cls", "max"]:
    found = _object(path)
    named = found.get("pooling_mode")
    chosen = (
        [
            _POOLINGS.get(key.removeprefix("pooling_mode_"), key.removeprefix("pooling_mode_"))
            for key, on in found.items()
            if key.startswith("pooling_mode_") and on is True
        ]
        if named is None
        else [named]
        if isinstance(named, str)
        else named
    )
    if chosen not in (["mean"], ["cls"], ["max"]):
        told = ", ".join(map(str, chosen)) if isinstance(chosen, list) else forms.found(chosen)
        raise RsaDataError(f"{path}: expected pooling by mean, cls or max; found {told or 'none'}")
    if prompt and found.get("include_prompt") is False:
        raise RsaDataError(
            f"{path}: include_prompt: expected true, since the model puts {prompt!r} before every "
            "text; found false, which is not computed here"
        )
    pooling: Literal["mean", "cls", "max"] = chosen[0]
    return pooling


def _check_normalizer(path: Path, tokens: dict[str, Any]) -> None:
    """Raises RsaDataError where the two files of a BERT tokenizer contradict each other.

    transformers follows tokenizer_config.json there, the tokenizers' library tokenizer.json.
    """
    kind = str(tokens.get("tokenizer_class", "")).removesuffix("Fast").removesuffix("Tokenizer")
    if kind not in _BERTS:
        return
    normalizer = _object(path).get("normalizer")
    if not isinstance(normalizer, dict) or normalizer.get("type") != "BertNormalizer":
        return
    for name, (key, usual) in _SETTINGS.items():
        wanted, there = tokens.get(key, usual), normalizer.get(name, usual)
        if wanted != there:
            raise RsaDataError(
                f"{path}: normalizer.{name}: expected {wanted}, as {key} of tokenizer_config.json "
                f"has it; found {there}. Which one the model was trained with is not known: make "
                "them agree"
            )
