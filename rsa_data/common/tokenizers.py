"""Tokenizers as captions and text encoders see them: counts, ids, the limit, a fingerprint."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from . import clip_bpe, typed
from . import minilm as minilm_model
from .errors import RsaDataError
from .sentence_folders import max_tokens

# More tokens than any encoder reads.
Limit = Annotated[int, msgspec.Meta(ge=1, le=2**14)]


@dataclass(frozen=True)
class Tokenizer:
    """What cuts texts into tokens.

    name : the name in the registry.
    max_tokens : the most tokens that its encoder reads, start and end tokens included.
    specials : start and end tokens that stand around every text.
    ids : texts -> the token ids of each, specials included, never cut.
    cut : (ids longer than a limit, the limit) -> the ids that the reference implementation keeps.
    additive : True when the tokens of pieces that meet at a space or at punctuation add up to the
        tokens of the whole, so that counts may come from tables.
    fingerprint : sha256 of the vocabulary; two tokenizers with equal ones give equal ids.
    """

    name: str
    max_tokens: int
    specials: int
    ids: Callable[[Sequence[str]], list[list[int]]]
    cut: Callable[[list[int], int], list[int]]
    additive: bool
    fingerprint: str

    def count(self, texts: Sequence[str]) -> np.ndarray:
        """int32 array of shape (n,): tokens of each text, start and end tokens included, uncut."""
        return np.fromiter(map(len, self.ids(texts)), np.int32, len(texts))

    def encode(
        self, texts: Sequence[str], max_tokens: int | None = None
    ) -> tuple[list[list[int]], np.ndarray]:
        """Ids of each text, at most `max_tokens` of them, and which texts were cut.

        max_tokens : start and end tokens included; None for the tokenizer's own limit.
        Returns the ids and a bool array of shape (n,), True where the text was longer.
        """
        limit = self.max_tokens if max_tokens is None else max_tokens
        ids = self.ids(texts)
        truncated = np.fromiter((len(row) > limit for row in ids), bool, len(ids))
        return [self.cut(row, limit) if len(row) > limit else row for row in ids], truncated


class _Config(msgspec.Struct, frozen=True):
    """What the files of a model's folder say of the tokens that it reads."""

    max_position_embeddings: Limit | None = None
    text_config: "_Config | None" = None


def keep_last(ids: list[int], limit: int) -> list[int]:
    """The first `limit` - 1 ids and the end token: how CLIP and BERT tokenizers cut."""
    return [*ids[: limit - 1], ids[-1]]


@cache
def clip() -> Tokenizer:
    """CLIP's byte-pair encoding, 49,408 tokens.

    Source of the limit: openai/CLIP, clip.py, context_length=77.
    """
    return Tokenizer("clip", 77, 2, clip_bpe.load(), keep_last, True, clip_bpe.FINGERPRINT)


@cache
def minilm() -> Tokenizer:
    """all-MiniLM-L6-v2's WordPiece, 30,522 tokens."""
    folder = minilm_model.folder_with("tokenizer.json")
    content = (folder / "tokenizer.json").read_bytes()
    ids, specials = _from_json(content)
    return Tokenizer(
        "minilm",
        _limit(folder),
        specials,
        ids,
        keep_last,
        True,
        hashlib.sha256(content).hexdigest(),
    )


@cache
def hf(argument: str) -> Tokenizer:
    """The tokenizer of any Hugging Face text encoder, by name or folder: hf:NAME_OR_DIR.

    Whether its pieces add up is not known, so texts are counted whole, which is slower.
    """
    from .pretrained import folder_of

    folder = folder_of(argument, None)
    files = [folder / name for name in ("tokenizer.json", "config.json")]
    if not all(file.is_file() for file in files):
        raise RsaDataError(
            f"tokenizer hf: expected tokenizer.json and config.json in {folder}; found "
            f"{', '.join(sorted(f.name for f in folder.iterdir())) or 'nothing'}"
        )
    content = files[0].read_bytes()
    ids, specials = _from_json(content)
    limit = _limit(folder)
    return Tokenizer(
        "hf", limit, specials, ids, keep_last, False, hashlib.sha256(content).hexdigest()
    )


def _from_json(content: bytes) -> tuple[Callable[[Sequence[str]], list[list[int]]], int]:
    """(texts -> uncut ids, start and end tokens of a text) of a tokenizer.json."""
    import tokenizers

    try:
        pieces = tokenizers.Tokenizer.from_buffer(content)
    except Exception as error:  # tokenizers' errors have no common base but Exception
        raise RsaDataError(f"tokenizer.json: expected a tokenizer: {error}") from error
    pieces.no_truncation()
    pieces.no_padding()

    def ids(texts: Sequence[str]) -> list[list[int]]:
        try:
            return [row.ids for row in pieces.encode_batch(list(texts))]
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:  # a panic of its Rust code is no Exception
            raise RsaDataError(f"tokenizer.json: the tokenizer is damaged: {error}") from error

    return ids, pieces.num_special_tokens_to_add(False)


def _limit(folder: Path) -> int:
    """The most tokens that the model of a folder reads, by what its files say."""
    if (folder / "modules.json").is_file() or (folder / "sentence_bert_config.json").is_file():
        return max_tokens(folder)
    config = _read(folder / "config.json")
    for part in (config.text_config, config):
        if part is not None and part.max_position_embeddings is not None:
            return part.max_position_embeddings
    raise RsaDataError(
        f"{folder}/config.json: expected max_position_embeddings, the tokens that the model reads"
    )


def _read(path: Path) -> "_Config":
    try:
        return typed.parse(path.read_bytes(), _Config, str(path))
    except OSError as error:
        raise RsaDataError(f"{path}: expected JSON: {error}") from error
