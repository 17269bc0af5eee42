"""The scripts in benchmarks/ load and say how they are called; the fuzzers take their own seeds."""

import runpy
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from rsa_data.common.errors import RsaDataError

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))


@pytest.mark.parametrize("name", sorted(path.name for path in BENCHMARKS.glob("*.py")))
@pytest.mark.filterwarnings("ignore")  # those of packages that only a benchmark imports
def test_a_script_loads_and_prints_its_help(name, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    monkeypatch.setattr(sys, "path", [*sys.path])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(BENCHMARKS / name), run_name="__main__")
    assert ended.value.code == 0
    assert "usage: " in capsys.readouterr().out


def importers():
    from fuzzing import IMPORTERS

    return IMPORTERS


@pytest.mark.parametrize("name", sorted(importers()))
@pytest.mark.filterwarnings("ignore")  # of the packages that read a damaged file
def test_a_fuzzed_importer_takes_most_of_its_seeds(name, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "work").mkdir()
    importer = importers()[name]
    one = importer.make(tmp_path / "work")
    seeds, taken = importer.seeds(), 0
    for seed in seeds:
        with suppress(RsaDataError):
            one(seed)
            taken += 1
    assert taken >= len(seeds) / 2
