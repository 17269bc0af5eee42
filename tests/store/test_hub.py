"""Data sets of the Hugging Face hub, against a stand-in."""

import pytest
from hub_server import Hub, here, hub

from rsa_data.common.errors import RsaDataError, TransientError
from rsa_data.store.hub import HubFiles

pytest.importorskip("huggingface_hub")


@pytest.fixture
def address(tmp_path, monkeypatch):
    (tmp_path / "hub/data").mkdir(parents=True)
    (tmp_path / "hub/data/a.txt").write_bytes(b"0123456789")
    (tmp_path / "hub/b.txt").write_bytes(b"b")
    with hub(tmp_path / "hub") as place:
        here(monkeypatch, place, tmp_path / "cache")
        yield place


def test_files_of_a_data_set(address):
    files = HubFiles("hf://datasets/owner/name")
    assert files.location == f"hf://datasets/owner/name@{Hub.commit}"
    assert files.list("") == ["b.txt", "data/"] and files.list("data/") == ["a.txt"]
    assert files.list("dat") == []
    assert files.read("data/a.txt") == b"0123456789" and files.size("data/a.txt") == 10
    assert files.head("data/a.txt", 3) == b"012" and files.span("data/a.txt", 8, 5) == b"89"
    for path in ("none.txt", ""):
        assert files.read(path) is files.size(path) is files.head(path, 3) is None


def test_a_data_set_that_is_not_there_is_told_in_one_line(address):
    # The hub's own answer goes on over several lines, which speak of the page and of tokens.
    with pytest.raises(RsaDataError, match=r"found: .*404.*Check the name, and `hf auth") as caught:
        HubFiles("hf://datasets/owner/other")
    assert not isinstance(caught.value, TransientError) and "\n" not in str(caught.value)


def test_a_hub_that_is_away_is_a_transient_error(address, monkeypatch):
    there = HubFiles("hf://datasets/owner/name")
    assert there.read("b.txt") == b"b"
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    # A file of a commit never changes: what is in the cache needs no hub.
    assert there.read("b.txt") == b"b"
    with pytest.raises(TransientError, match=r"cannot read .*data/a\.txt: .*same command again"):
        there.read("data/a.txt")
