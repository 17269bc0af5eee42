"""The chain killed at a few moments; benchmarks/crash.py does it at all failpoints and 50 more."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "crash.py"


@pytest.mark.slow
def test_a_killed_chain_ends_with_the_bytes_of_an_undisturbed_one():
    words = [sys.executable, str(SCRIPT), "--only", "chain", "--random", "1"]
    words += ["--failpoints", "receipt,checkpoint"]
    ended = subprocess.run([*words, "--once"], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "3 killed, 0 ended otherwise than undisturbed" in ended.stdout
