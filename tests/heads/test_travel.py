"""Heads that travel: exported, read from a file, an address or by a ready name."""

import functools
import http.server
import json
import shlex
import shutil
import threading

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from hub_server import Hub, here, hub
from safetensors.torch import load_file, save_file

from rsa_data.cli.main import cli
from rsa_data.common import cards, model_files
from rsa_data.common.errors import RsaDataError, UsageError
from rsa_data.heads import travel
from rsa_data.heads.checkpoint import ScaleHead, build_network
from rsa_data.heads.predict.find import find
from rsa_data.store.tables import WorkDir

FEATURES = np.random.default_rng(0).normal(size=(5, 384)).astype(np.float32)


@pytest.fixture
def work(tmp_path) -> WorkDir:
    """Two heads, untrained."""
    work = WorkDir(tmp_path / "work")
    features = {"dim": 384, "style": "occupancy", "encoder": "minilm", "files": None}
    features["options"] = {"encoder": "minilm", "normalize": False}
    for seed, name in enumerate(("one", "two")):
        torch.manual_seed(seed)
        about = {"format": 1, "architecture": {"name": "mlp3"}, "features": features}
        about["depth_model"] = {"model": "tu2020", "geometry": {"a": {"geometry": "320x240"}}}
        about["datasets"] = {"nyuv2": {"images": 7, "validation_images": 2}}
        network = build_network(about["architecture"], 384)
        head = ScaleHead(network, about, torch.zeros(384), torch.ones(384))
        head.save(work.store, f"heads/{name}")
    return work


@pytest.mark.parametrize("place", ["one.safetensors", "folder"])
def test_a_head_is_the_same_elsewhere(work, tmp_path, place):
    there = tmp_path / "new" / place
    words = ["export-head", "one", str(there), "--work", work.store.location]
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 0, done.output
    # What it suggests runs as printed; without a caption of the training set it takes another.
    (line,) = [line for line in done.output.splitlines() if line.startswith("next: rsa-data ")]
    again = CliRunner().invoke(cli, shlex.split(line)[2:])
    assert again.exit_code == 0 and again.output.startswith("scale ")
    head, own = find(WorkDir(tmp_path / "none"), str(there)), find(work, "one")
    for mine, theirs in zip(own(FEATURES), head(FEATURES), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert head.description["depth_model"]["model"] == "tu2020"
    card = (there / "README.md").read_text() if there.is_dir() else _metadata(there)["README.md"]
    for text in ("mlp3", "minilm", "occupancy", "tu2020", "320x240", "nyuv2: 7 images", "Licences"):
        assert text in card


def _metadata(path):
    data = path.read_bytes()
    return json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])["__metadata__"]


def test_a_path_comes_before_a_name_and_a_name_before_a_ready_one(work, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(work.store.folder / "heads/one", tmp_path / "two")
    with pytest.warns(UserWarning, match="several of this name; the path two is taken"):
        two = find(work, "two")
    np.testing.assert_array_equal(two(FEATURES), find(work, "one")(FEATURES))
    shutil.rmtree(tmp_path / "two")
    assert not np.array_equal(find(work, "two")(FEATURES)[0], find(work, "one")(FEATURES)[0])
    with pytest.raises(UsageError, match="holds several: one, two"):
        find(work, None)
    # Of several the one of the default name, wherever it stands among them.
    for name, of in (("head", "two"), ("a", "one")):
        shutil.copytree(work.store.folder / "heads" / of, work.store.folder / "heads" / name)
    np.testing.assert_array_equal(find(work, None)(FEATURES), find(work, "two")(FEATURES))
    for name in ("head", "a"):
        shutil.rmtree(work.store.folder / "heads" / name)
    with pytest.raises(UsageError, match=r"Did you mean 'rsa-midas'"):
        find(work, "rsa-mida")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda about: about["architecture"].update(name="os:system"), "os:system"),
        (lambda about: about.update(format=9), "expected format 1; found 9"),
        (lambda about: about["features"].update(dim=12), "expected"),
    ],
)
def test_a_file_that_asks_for_anything_else_is_refused(work, tmp_path, change, message):
    path = tmp_path / "h.safetensors"
    travel.export_head(work, "one", path)
    about = json.loads(_metadata(path)["head.json"])
    change(about)
    save_file(load_file(path), path, {"head.json": json.dumps(about)})
    with pytest.raises(RsaDataError, match=message):
        find(work, str(path))


def test_a_head_of_the_hub(work, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_DISABLE_PROGRESS_BARS", "1")
    travel.export_head(work, "one", tmp_path / "hub")
    with hub(tmp_path / "hub") as address:
        here(monkeypatch, address, tmp_path / "cache")
        head = find(work, f"hf://owner/name@{Hub.commit}")
        np.testing.assert_array_equal(head(FEATURES), find(work, "one")(FEATURES))
        # One line of the hub's answer, which goes on over several.
        with pytest.raises(
            RsaDataError, match=r"hf://owner/none: cannot be fetched: .*404.*$"
        ) as no:
            find(work, "hf://owner/none")
    assert "\n" not in str(no.value)
    with pytest.raises(UsageError, match="expected hf://OWNER/NAME or"):
        find(work, "hf://owner")


@pytest.mark.parametrize("data", [b"", b"no head", b"\x10\0\0\0\0\0\0\0{}", b"\xff" * 8 + b"{"])
def test_other_files_are_refused(work, tmp_path, data):
    path = tmp_path / "h.safetensors"
    path.write_bytes(data)
    with pytest.raises(RsaDataError, match=r"h\.safetensors"):
        find(work, str(path))
    save_file({"a": torch.zeros(1)}, path)
    with pytest.raises(RsaDataError, match="expected a file of `rsa-data export-head`"):
        find(work, str(path))


def test_a_ready_head_knows_its_depth_model(work, shared, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    card = cards.read_card(cards.card_path("rsa-depth-anything"))
    place = model_files.cached_path(card)
    place.parent.mkdir(parents=True)
    shutil.copy(shared / "rsa_heads/da_lanscale.pt", place)
    head = find(work, "rsa-depth-anything")
    assert head.description["depth_model"]["model"] == "depth-anything-small"
    (way,) = head.description["depth_model"]["geometry"].values()
    assert way["geometry"] == "560x434"
    place.write_bytes(b"other bytes")
    with pytest.raises(RsaDataError, match=f"expected sha256 {card.sha256}"):
        find(work, "rsa-depth-anything")


def test_a_head_at_an_address_and_what_is_wrong_with_another(work, tmp_path):
    travel.export_head(work, "one", tmp_path / "one.safetensors")
    (tmp_path / "cut.safetensors").write_bytes((tmp_path / "one.safetensors").read_bytes()[:900])
    handler = functools.partial(Quiet, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_address[1]}"
        head = find(work, f"{address}/one.safetensors")
        np.testing.assert_array_equal(head(FEATURES), find(work, "one")(FEATURES))
        with pytest.raises(RsaDataError, match=f"--head {address}/cut.safetensors: expected a h"):
            find(work, f"{address}/cut.safetensors")
        with pytest.raises(UsageError, match="without a user's name or password") as refused:
            find(work, f"{address.replace('//', '//me:word@')}/one.safetensors")
        assert ":word" not in str(refused.value)
        server.shutdown()


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.mark.parametrize(
    "prior",
    [
        {"scale": -1e308, "shift": 1.0, "correlation": 0.0},
        {"scale": 1.0, "shift": 1e-320, "correlation": 0.0},
        {"scale": 1.0, "shift": 1.0, "correlation": 7.0},
    ],
)
def test_a_prior_that_no_head_can_have_is_refused(work, tmp_path, prior):
    path = tmp_path / "one.safetensors"
    travel.export_head(work, "one", path)
    metadata = _metadata(path)
    about = {**json.loads(metadata["head.json"]), "prior": prior}
    del about["digest"]
    save_file(load_file(path), path, {**metadata, "head.json": json.dumps(about)})
    with pytest.raises(RsaDataError, match=r"one\.safetensors.*prior"):
        find(work, str(path))
