"""pandas is imported where it is used, and then pyarrow knows its types."""

import subprocess
import sys

import pytest

NULLS = "import pandas as pd; print(pa.array(pd.Series([1.0, float('nan')])).null_count)"
FRAME = "print(len(pa.table({'a': [1, 2]}).to_pandas()))"


def python(code: str) -> str:
    words = [sys.executable, "-c", code]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize(("use", "printed"), [(NULLS, "1"), (FRAME + "\n" + NULLS, "2 1")])
def test_is_as_if_it_had_been_there(use: str, printed: str) -> None:
    begin = (
        "import sys, pyarrow as pa\n"
        "from rsa_data.common import pandas_later\n"
        "pandas_later.install()\n"
        "pa.array(['a']), pa.table({'a': [1]})\n"
        "assert 'pandas' not in sys.modules\n"
    )
    assert python(begin + use).split() == printed.split()
    assert python("import pyarrow as pa\n" + use).split() == printed.split()


def test_commands_do_without_it(tmp_path) -> None:
    code = (
        "import sys\n"
        "from rsa_data.__main__ import main\n"
        f"sys.argv = ['rsa-data', 'status', '--work', {str(tmp_path)!r}]\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "import pyarrow as pa; pa.array([1])\n"
        "assert 'pandas' not in sys.modules\n"
    )
    python(code)
