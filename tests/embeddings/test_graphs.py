"""The cache of encoders' graphs: damaged or swapped files, leftovers, locks, a full disk."""

import os
import resource
import shutil
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tiny_encoders
import torch

from rsa_data.common.errors import RsaDataError
from rsa_data.embeddings.clip_text import TextTower
from rsa_data.embeddings.encoder import TextModel
from rsa_data.embeddings.graphs import graph
from rsa_data.embeddings.running import in_onnx, in_torch

pytest.importorskip("onnxscript")


def encoder(seed: int) -> TextModel:
    torch.manual_seed(seed)
    tower = TextTower(width=16, heads=1, layers=1, dim=8).eval()
    for parameter in tower.parameters():
        torch.nn.init.normal_(parameter)
    return replace(tiny_encoders.load({}), network=lambda: tower, dim=8)


TINY, OTHER = encoder(0), encoder(1)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A cache with the graphs of both encoders."""
    base = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(base))
        graph(TINY, {"code": "tiny"})
        graph(OTHER, {"code": "other"})
    return base


@pytest.fixture
def cache(made, tmp_path, monkeypatch) -> Path:
    base = tmp_path / "cache"
    shutil.copytree(made, base)
    monkeypatch.setenv("XDG_CACHE_HOME", str(base))
    return base


def features(path: Path) -> np.ndarray:
    ids = TINY.tokenize(["An image with a bed."])[0]
    (answer,) = in_onnx(path, 1)(TINY.batches(ids, 64))
    return answer[1]


def expected() -> np.ndarray:
    ids = TINY.tokenize(["An image with a bed."])[0]
    (answer,) = in_torch(TINY.module, "float32", "cpu")(TINY.batches(ids, 64))
    return answer[1]


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def swapped(path: Path, other: Path) -> None:
    shutil.copy(other, path)


def swapped_with_digest(path: Path, other: Path) -> None:
    for ending in ("", ".sha256"):
        shutil.copy(f"{other}{ending}", f"{path}{ending}")


def truncated(path: Path, other: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)
    # What a killed export leaves goes as well.
    path.with_name(".float32.onnx.01234567.tmp").write_bytes(b"half")


def without_digest(path: Path, other: Path) -> None:
    path.with_name("float32.onnx.sha256").unlink()


def test_a_graph_that_holds_is_used_in_a_cache_that_cannot_be_written(cache, capfd):
    before = {path: path.stat().st_mtime_ns for path in cache.rglob("*")}
    folder = graph(TINY, {"code": "tiny"}).parent
    folder.chmod(0o500)
    path = graph(TINY, {"code": "tiny"})
    folder.chmod(0o700)
    assert {path: path.stat().st_mtime_ns for path in cache.rglob("*")} == before
    np.testing.assert_allclose(features(path), expected(), rtol=1e-4, atol=1e-5)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("damage", [swapped, swapped_with_digest, truncated, without_digest])
def test_another_graph_in_its_place_is_made_anew(cache, capfd, damage):
    path, other = graph(TINY, {"code": "tiny"}), graph(OTHER, {"code": "other"})
    before = names(path.parent)
    damage(path, other)
    assert graph(TINY, {"code": "tiny"}) == path
    np.testing.assert_allclose(features(path), expected(), rtol=1e-4, atol=1e-5)
    why = "has no digest" if damage is without_digest else "does not match its digest"
    assert capfd.readouterr().err == f"{path}: this graph {why}; making it anew\n"
    assert names(path.parent) == before
    graph(TINY, {"code": "tiny"})
    assert capfd.readouterr().err == ""


def test_int8_is_made_of_the_right_graph(cache):
    path, other = graph(TINY, {"code": "tiny"}), graph(OTHER, {"code": "other"})
    swapped(path, other)
    rounded = graph(TINY, {"code": "tiny"}, int8=True)
    found, wanted = features(rounded)[0], expected()[0]
    assert found @ wanted > 0.99 * np.linalg.norm(found) * np.linalg.norm(wanted)
    truncated(rounded, other)
    assert np.array_equal(features(graph(TINY, {"code": "tiny"}, int8=True))[0], found)


@pytest.mark.slow
def test_what_a_killed_export_leaves_goes_with_the_next(cache):
    path = graph(TINY, {"code": "tiny"})
    before = names(path.parent)
    path.unlink()
    code = (
        "import tiny_encoders; from rsa_data.embeddings.graphs import graph; "
        "graph(tiny_encoders.load({}), {'code': 'tiny'})"
    )
    helpers = str(Path(tiny_encoders.__file__).parent)
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([helpers, *sys.path]),
        "RSA_DATA_FAILPOINT": "rename",
    }
    subprocess.run([sys.executable, "-c", code], env=environment, check=False, timeout=60)
    assert any(name.endswith(".tmp") for name in names(path.parent))
    graph(TINY, {"code": "tiny"})
    assert names(path.parent) == before


def test_who_waits_for_a_lock_says_for_which(cache, capfd):
    path = graph(TINY, {"code": "tiny"})
    path.unlink()
    lock = path.with_name("lock")
    code = (
        "import filelock, sys; lock = filelock.FileLock(sys.argv[1]); lock.acquire(); "
        "print(flush=True); sys.stdin.read()"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", code, lock], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert holder.stdout and holder.stdin
    holder.stdout.readline()
    end = threading.Timer(4, holder.stdin.close)
    end.start()
    graph(TINY, {"code": "tiny"})
    holder.wait(10)
    end.join()
    holder.stdout.close()
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"Waiting for {lock}: another process is making this encoder's graph")


def test_a_full_disk_is_not_the_encoders_fault(cache):
    path = graph(TINY, {"code": "tiny"})
    path.unlink()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, before[1]))
    try:
        with pytest.raises(RsaDataError) as raised:
            graph(TINY, {"code": "tiny"})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert str(raised.value).startswith(f"{path.parent}: expected to write the encoder's graph")
    assert "XDG_CACHE_HOME" in str(raised.value) and "exported" not in str(raised.value)
    assert not [name for name in names(path.parent) if name.endswith(".tmp")]


@pytest.mark.parametrize("name", ["float32.onnx", "float32.onnx.sha256", "lock"])
def test_a_folder_in_the_way_is_named(cache, name):
    path = graph(TINY, {"code": "tiny"})
    path.unlink()
    path.with_name(name).unlink(missing_ok=True)
    path.with_name(name).mkdir()
    with pytest.raises(RsaDataError) as raised:
        graph(TINY, {"code": "tiny"})
    assert str(raised.value).startswith(f"{path.with_name(name)}: expected a file")
    assert "found a folder" in str(raised.value)
