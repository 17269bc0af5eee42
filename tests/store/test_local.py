"""A store in a folder: what file systems answer that are full, far away or know no links."""

import errno
import os
import stat

import pytest

from rsa_data.common.errors import RsaDataError, TransientError, UsageError
from rsa_data.store.local import LocalStore
from rsa_data.store.stores import open_store


@pytest.fixture
def store(tmp_path):
    return LocalStore(tmp_path)


def refusing(call, number, *, when=lambda *arguments: True):
    """The call of os, which answers with the error where `when` says so."""

    def instead(*arguments, **more):
        if when(*arguments):
            raise OSError(number, os.strerror(number))
        return call(*arguments, **more)

    return instead


def is_folder(descriptor) -> bool:
    return stat.S_ISDIR(os.fstat(descriptor).st_mode)


@pytest.mark.parametrize("number", [errno.EIO, errno.ESTALE, errno.ETIMEDOUT])
def test_a_server_that_is_away_may_come_back(store, monkeypatch, number):
    monkeypatch.setattr("os.fsync", refusing(os.fsync, number))
    says = f"cannot write a/b: {os.strerror(number)}. This may pass: run the same command again"
    with pytest.raises(TransientError, match=says):
        store.write("a/b", b"data")


def test_a_full_disk_does_not_pass_by_itself(store, tmp_path, monkeypatch):
    monkeypatch.setattr("os.fsync", refusing(os.fsync, errno.ENOSPC))
    with pytest.raises(RsaDataError, match="What was committed before is valid") as caught:
        store.create("a/b", b"data")
    assert not isinstance(caught.value, TransientError)
    assert list((tmp_path / "a").iterdir()) == []


@pytest.mark.parametrize("number", [errno.EPERM, errno.ENOTSUP, errno.ENOSYS])
def test_without_hard_links_a_name_is_still_given_once(store, tmp_path, monkeypatch, number):
    """link(2): EPERM where the file system has none, as exFAT."""
    monkeypatch.setattr("os.link", refusing(os.link, number))
    assert store.create("a/b", b"one") and store.create("a/b", b"one")
    assert not store.create("a/b", b"two")
    assert store.read("a/b") == b"one" and list((tmp_path / "a").iterdir()) == [tmp_path / "a/b"]
    monkeypatch.setattr("os.link", refusing(os.link, errno.EACCES))
    with pytest.raises(RsaDataError, match="cannot write a/c: Permission denied"):
        store.create("a/c", b"one")


@pytest.mark.parametrize("number", [errno.EINVAL, errno.ENOTSUP])
def test_folders_that_cannot_be_flushed_are_written(store, monkeypatch, number):
    """fsync(2): EINVAL for what does not support it."""
    monkeypatch.setattr("os.fsync", refusing(os.fsync, number, when=is_folder))
    store.write("a/b", b"one")
    assert store.create("a/c", b"two")
    assert (store.read("a/b"), store.read("a/c")) == (b"one", b"two")
    monkeypatch.setattr("os.fsync", refusing(os.fsync, errno.EIO, when=is_folder))
    with pytest.raises(TransientError, match="cannot write a/b"):
        store.write("a/b", b"one")


@pytest.mark.parametrize("name", ["", "work\udcff"])
def test_a_work_dir_has_a_name_that_can_be_printed(name):
    with pytest.raises(UsageError, match="--work: expected the name of a folder in UTF-8; found"):
        open_store(name)
