"""Commands killed at a few moments of their commits; benchmarks/crash.py does it at all of them."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "crash.py"


@pytest.mark.slow
def test_killed_commands_end_with_the_bytes_of_undisturbed_ones():
    words = [sys.executable, str(SCRIPT), "--step", "40", "--random", "1"]
    words += ["--only", "captions$|train-head$|evaluate$"]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    found = re.search(r"(\d+) trials, (\d+) killed, 0 ended otherwise", ended.stdout)
    assert found and int(found[1]) == int(found[2]) >= 9, ended.stdout
