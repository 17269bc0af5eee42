"""Model files: local, cached, downloaded with their checksum, or not to be had."""

import hashlib
import http.server
import os
import subprocess
import sys
import threading
from functools import partial
from pathlib import Path

import pytest
from own_models import write_semantic

from rsa_data.common import cards, model_files, onnx_sessions
from rsa_data.common.cards import Card
from rsa_data.common.errors import RsaDataError, UsageError

CONTENT = b"weights" * 1000
SHA = hashlib.sha256(CONTENT).hexdigest()


class Handler(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass

    def do_GET(self):
        if "truncated" in self.path:
            self.send_response(200)
            self.send_header("Content-Length", str(len(CONTENT)))
            self.end_headers()
            self.wfile.write(CONTENT[:100])
        elif "busy" in self.path:
            self.send_error(503)
        else:
            super().do_GET()


@pytest.fixture
def served(tmp_path, monkeypatch):
    """The address of a server on this machine that has CONTENT at /model.onnx; an empty cache."""
    folder = tmp_path / "served"
    folder.mkdir()
    (folder / "model.onnx").write_bytes(CONTENT)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    server = http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), partial(Handler, directory=str(folder))
    )
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    thread.join()
    server.server_close()


def left_in(folder: Path) -> list[str]:
    return [p.name for p in folder.rglob("*") if p.is_file()]


def test_download_then_cache(served, tmp_path):
    card = Card(name="m", url=f"{served}/model.onnx", sha256=SHA)
    path = model_files.local_file(card)
    assert path.read_bytes() == CONTENT
    assert left_in(tmp_path / "cache") == ["model.onnx"]
    (tmp_path / "served" / "model.onnx").unlink()
    assert model_files.local_file(card) == path


@pytest.mark.parametrize(
    ("name", "sha", "message"),
    [
        ("model.onnx", "0" * 64, f"expected sha256 {'0' * 64} of .*; found {SHA}: nothing"),
        ("truncated.onnx", SHA, "expected 7000 bytes, got 100"),
        ("missing.onnx", SHA, "HTTP Error 404"),
        ("busy.onnx", SHA, "HTTP Error 503"),
    ],
)
def test_a_bad_download_leaves_nothing(served, tmp_path, name, sha, message):
    card = Card(name="m", url=f"{served}/{name}", sha256=sha)
    with pytest.raises(RsaDataError, match=message):
        model_files.local_file(card)
    assert left_in(tmp_path / "cache") == []


def test_offline_says_which_file_goes_where(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    card = Card(name="m", url="http://127.0.0.1:9/model.onnx", sha256=SHA)
    with pytest.raises(RsaDataError) as error:
        model_files.local_file(card, option="--model")
    place = model_files.cached_path(card)
    for part in (card.url, SHA, str(place), "--model FILE"):
        assert part in str(error.value)
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(CONTENT)
    assert model_files.local_file(card) == place


def test_a_damaged_cache_is_not_used(served):
    card = Card(name="m", url=f"{served}/model.onnx", sha256=SHA)
    path = model_files.local_file(card)
    path.write_bytes(CONTENT[:-1])
    with pytest.raises(RsaDataError, match="Delete that file and run again"):
        model_files.local_file(card)
    path.unlink()
    assert model_files.local_file(card).read_bytes() == CONTENT


def test_a_file_of_the_users_own(tmp_path):
    own = tmp_path / "own.onnx"
    card = Card(name="m")
    with pytest.raises(RsaDataError, match="it is a file of your own: give it as --weights FILE"):
        model_files.local_file(card)
    with pytest.raises(RsaDataError, match="--model: expected the model's file; there is none at"):
        model_files.local_file(card, own, "--model")
    own.write_bytes(b"")
    assert model_files.local_file(card, own) == own


HUB = """
import sys
from rsa_data.common import model_files
from rsa_data.common.cards import Card
from rsa_data.common.errors import RsaDataError

card = Card(
    name="m", hub="owner/name", file="onnx/model.onnx", revision="a" * 40, sha256=sys.argv[1]
)
try:
    print(model_files.local_file(card).read_bytes() == b"weights" * 1000)
except RsaDataError as error:
    print(error)
"""


class Hub(Handler):
    """As much of the hub as one file needs: its size, ETag and commit, and its bytes."""

    def answer(self):
        if self.path != f"/owner/name/resolve/{'a' * 40}/onnx/model.onnx":
            self.send_error(404)
            return False
        self.send_response(200)
        self.send_header("Content-Length", str(len(CONTENT)))
        self.send_header("ETag", f'"{SHA}"')
        self.send_header("X-Repo-Commit", "a" * 40)
        self.end_headers()
        return True

    def do_HEAD(self):
        self.answer()

    def do_GET(self):
        if self.answer():
            self.wfile.write(CONTENT)


def ask_hub(sha, folder, endpoint, **more):
    """What a process of its own prints: the hub's client reads its settings once, when imported."""
    settings = {"HF_ENDPOINT": endpoint, "HF_HOME": str(folder), "XDG_CACHE_HOME": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", HUB, sha],
        env=os.environ | settings | more,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("sha", "expected"),
    [(SHA, "True"), ("0" * 64, f"model m: expected sha256 {'0' * 64} of")],
    ids=["right", "wrong checksum"],
)
def test_the_hub(tmp_path, sha, expected):
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Hub)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    endpoint = f"http://127.0.0.1:{server.server_port}"
    try:
        assert ask_hub(sha, tmp_path, endpoint).startswith(expected)
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
    # The second time from the cache: the server is gone.
    assert ask_hub(sha, tmp_path, endpoint, HF_HUB_OFFLINE="1").startswith(expected)


def test_the_hub_out_of_reach(tmp_path):
    message = ask_hub(SHA, tmp_path, "http://no-such-host.invalid")
    assert f"https://huggingface.co/owner/name/resolve/{'a' * 40}/onnx/model.onnx" in message
    assert f"{tmp_path}/rsa-data/models/m-{SHA[:16]}/model.onnx" in message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = ", "expected a TOML file"),
        ('hub = "a/b"', "expected file, and revision or sha256"),
        ('url = "https://x/y"', "with a url expected its sha256"),
        ("licence = 3", r"mine.toml.licence: expected text or nothing, found 3"),
        ('name = "a/b"', "expected the name of a file; found 'a/b'"),
    ],
)
def test_bad_cards(tmp_path, text, message):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(RsaDataError, match=message):
        cards.read_card(path)


def test_every_shipped_card_is_whole():
    for kind in ("segments", "relative-depth", "text-encoder"):
        assert cards.names(kind)
        for name in cards.names(kind):
            card = cards.card_of(kind, name)
            assert card.licence, name
            assert len(card.sha256 or "0" * 64) == 64
            assert len(card.revision or "0" * 40) == 40


def test_unknown_cards():
    with pytest.raises(UsageError, match="Did you mean 'yolox-nano'"):
        cards.card_of("segments", "yolox-nan")
    with pytest.raises(UsageError, match="unknown segments model 'clip-rn50'"):
        cards.card_of("segments", "clip-rn50")


def test_a_file_that_is_no_model(tmp_path):
    path = tmp_path / "m.onnx"
    path.write_bytes(b"not a model")
    with pytest.raises(RsaDataError, match="expected an ONNX model that onnxruntime can run"):
        onnx_sessions.open_session(path)


def test_cuda_where_there_is_none(tmp_path):
    import onnxruntime

    if "CUDAExecutionProvider" in onnxruntime.get_available_providers():
        pytest.skip("this onnxruntime has CUDA")
    with pytest.raises(UsageError, match="this onnxruntime has no CUDA; install onnxruntime-gpu"):
        onnx_sessions.open_session(tmp_path / "m.onnx", device="cuda")


def test_cuda_that_cannot_be_loaded(monkeypatch, tmp_path, capsys):
    """onnxruntime-gpu without CUDA's libraries opens a session on the CPU, without an error."""
    import onnxruntime

    small_model = write_semantic(tmp_path / "same.onnx")
    real = onnxruntime.InferenceSession

    def falls_back(path, options, providers):
        assert providers[0][0] == "CUDAExecutionProvider"
        return real(path, options, providers=["CPUExecutionProvider"])

    providers = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: providers)
    monkeypatch.setattr(onnxruntime, "InferenceSession", falls_back)
    monkeypatch.setattr(onnx_sessions, "gpu_driver", lambda: False)
    with pytest.raises(UsageError, match="no GPU driver was found"):
        onnx_sessions.open_session(small_model, device="cuda")
    monkeypatch.setattr(onnx_sessions, "gpu_driver", lambda: True)
    with pytest.raises(UsageError, match=r"cannot load CUDA.*use --device cpu"):
        onnx_sessions.open_session(small_model, device="cuda")
    session = onnx_sessions.open_session(small_model)
    assert session.get_providers() == ["CPUExecutionProvider"]
    assert "running on the CPU" in capsys.readouterr().err
