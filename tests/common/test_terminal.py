"""What a terminal would obey never reaches it from names, labels or servers."""

import os
import subprocess
import sys
import unicodedata

import pytest

from rsa_data.common.terminal import plain


def test_control_characters_become_their_escapes():
    assert plain("a\x1b[31mred\x07\x9b2J\u202eb\r") == r"a\x1b[31mred\x07\x9b2J\u202eb\r"
    for code in range(0x3000):
        shown = plain(chr(code))
        if unicodedata.category(chr(code)) in ("Cc", "Zl", "Zp") and chr(code) not in "\t\n":
            assert shown.isascii() and shown.isprintable(), hex(code)


def test_other_text_is_left_alone():
    for text in ("", "ünï-cødé 部屋 🛏\n", "a\tb\n\nc", r"C:\x1b"):
        assert plain(text) == text


@pytest.mark.parametrize("words", [["list", "\x1b[31mx\x07"], ["\x1b[31m"], ["show", "\x9b2J"]])
def test_neither_stream_of_a_command_passes_them_on(words, tmp_path):
    made = subprocess.run(
        [sys.executable, "-m", "rsa_data", *words],
        cwd=tmp_path, capture_output=True, env={**os.environ, "PYTHONIOENCODING": "utf-8"},
    )  # fmt: skip
    said = (made.stdout + made.stderr).decode()
    assert made.returncode in (1, 2)
    assert plain(said) == said and "\\x" in said
