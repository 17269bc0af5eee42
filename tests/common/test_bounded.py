"""The bounded reader: what is over a limit, endless or nested without end is refused by words."""

import json
import os
import tomllib

import pytest

from rsa_data.common import bounded
from rsa_data.common.errors import UsageError


def test_a_file_is_read_whole(tmp_path):
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfx\r\ny")
    assert bounded.read(tmp_path / "a", "text") == b"\xef\xbb\xbfx\r\ny"
    assert bounded.read_text(tmp_path / "a") == "x\r\ny"


@pytest.mark.parametrize("kind", ["image", "text", "toml", "record"])
def test_a_sparse_file_of_20_gb_is_refused_unread(tmp_path, kind):
    path = tmp_path / "a"
    path.touch()
    os.truncate(path, 20 << 30)
    with pytest.raises(bounded.Refused, match=rf"found 21\.5 GB; RSA_DATA_LIMITS={kind}=SIZE"):
        bounded.read(path, kind)


def test_what_never_ends_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zeros").symlink_to("/dev/zero")
    for name in ("pipe", "zeros"):
        with pytest.raises(bounded.Refused, match="expected a file, found a pipe, socket or dev"):
            bounded.read(tmp_path / name, "image")


def test_a_file_that_grows_while_it_is_read_is_cut_off_at_the_limit(monkeypatch):
    class Growing:
        def open(self, mode):
            return open("/dev/zero", "rb")  # noqa: PTH123

    monkeypatch.setenv(bounded.VARIABLE, "image=1MB")
    with pytest.raises(bounded.Refused, match=r"at most 1\.0 MB, found 1\.0 MB"):
        bounded.read(Growing(), "image")


def test_missing_files_and_folders_raise_as_opening_does(tmp_path):
    with pytest.raises(FileNotFoundError):
        bounded.read(tmp_path / "none", "image")
    with pytest.raises(IsADirectoryError):
        bounded.read(tmp_path, "image")


@pytest.mark.parametrize(
    "text", ["[" * 200_000, '{"a":' * 100_000, "9" * 5000, "", "{", "nope", '{"a": 1,}']
)
def test_json_that_is_none_raises_value_error(text):
    for data in (text, text.encode()):
        with pytest.raises(ValueError):
            bounded.parse_json(data)


def test_json_is_what_json_makes_of_it():
    text = '{"a": [1, 2.5, "\\u00e9", null], "a": {}}'
    assert bounded.parse_json(text) == bounded.parse_json(text.encode()) == json.loads(text)


def test_json_is_refused_before_its_values_fill_memory(monkeypatch):
    monkeypatch.setenv(bounded.VARIABLE, "json=10MB")
    with pytest.raises(bounded.Refused, match="RSA_DATA_LIMITS=json=SIZE"):
        bounded.parse_json(b"[" + b"[]," * 100_000 + b"[]]")
    assert bounded.parse_json(b"[" + b"7," * 1000 + b"7]") == [7] * 1001


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 100_000,
        "a = " + "{a=" * 5000,
        "a = " + "9" * 5000,
        "[[[",
        ".".join(["a"] * 20_000) + " = 1",
    ],
)
def test_toml_that_is_none_raises_value_error(text):
    with pytest.raises(ValueError):
        bounded.parse_toml(text)


def test_toml_is_what_tomllib_makes_of_it(tmp_path):
    (tmp_path / "a.toml").write_text('a = 1\n[b]\nc = "é"\n', "utf-8")
    expected = tomllib.loads((tmp_path / "a.toml").read_text("utf-8"))
    assert bounded.read_toml(tmp_path / "a.toml") == expected


def test_limits_can_be_raised_for_one_command(tmp_path, monkeypatch):
    (tmp_path / "a").write_bytes(bytes(3000))
    monkeypatch.setenv(bounded.VARIABLE, "text=2kB, request=5s")
    with pytest.raises(bounded.Refused):
        bounded.read(tmp_path / "a", "text")
    assert bounded.limit("request") == 5
    monkeypatch.setenv(bounded.VARIABLE, "text=4kB")
    assert len(bounded.read(tmp_path / "a", "text")) == 3000


@pytest.mark.parametrize(
    "text",
    [
        "bogus=3",
        "image",
        "image=",
        "image=-1",
        "image=0",
        "image=nan",
        "image=3XB",
        "request=0s",
        "request=inf",
        "request=x",
    ],
)
def test_limits_that_make_no_sense_are_a_wrong_call(text, monkeypatch):
    monkeypatch.setenv(bounded.VARIABLE, text)
    with pytest.raises(UsageError, match="RSA_DATA_LIMITS"):
        bounded.limit("image")
