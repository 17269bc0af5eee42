"""Ways of doing the same work, each a process of its own, and how a round is measured."""

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import recording

from rsa_data.store import logs
from rsa_data.store.tables import WorkDir


@dataclass(frozen=True)
class Given:
    """What every row gets.

    python : of the peers. threads : of each side. small : a tiny amount of work, to try the script.
    shared : real data. options : further ones by name.
    """

    folder: Path
    python: str
    threads: int
    shared: Path
    small: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Run:
    """One process: CPU seconds of all of it and of the work itself, wall seconds, peak memory.

    found : what it found, for the comparison of results.
    """

    cpu: float
    steady: float
    wall: float
    megabytes: float
    found: Any


@dataclass(frozen=True)
class Way:
    """name : as tables show it. run : does the work once. ours : whether it is this project's."""

    name: str
    run: Callable[[], Run]
    ours: bool = False


@dataclass(frozen=True)
class Row:
    """The same work done in several ways.

    count, unit : how much work a run is. agree : what was found, by way -> a sentence of each on
    how far it agrees with the first peer's.
    """

    title: str
    count: int
    unit: str
    ways: tuple[Way, ...]
    agree: Callable[[Mapping[str, Any]], Mapping[str, str]]
    note: str = ""


def process(given: Given, command: list[str]) -> tuple[float, float, float, str]:
    """CPU seconds, wall seconds, peak MB and standard output of a command that must succeed."""
    threads = str(given.threads)
    quiet = {
        "OMP_NUM_THREADS": threads,
        "TOKENIZERS_PARALLELISM": "false",
        "HF_HUB_OFFLINE": "1",
        "HF_HOME": str(given.folder / "hub"),
    }
    return recording.spent(command, quiet)


def peer(
    given: Given, script: str, *, python: str | None = None, read: Any = np.load, **words: Any
) -> Run:
    """A peer's script; `read` gives what it found from the file that it wrote."""
    out = given.folder / "out.npy"
    content = {"out": str(out), "threads": given.threads, **words}
    file = Path(__file__).parent / f"their_{script}.py"
    command = [python or given.python, str(file), json.dumps(content, default=str)]
    cpu, wall, megabytes, said = process(given, command)
    steady = json.loads(said.strip().splitlines()[-1])["steady"]
    return Run(cpu, steady, wall, megabytes, read(out))


def ours(given: Given, work: Path, *words: Any) -> tuple[float, float, float]:
    """CPU seconds, wall seconds and peak MB of a command of this project."""
    command = [sys.executable, "-m", "rsa_data", *map(str, words), "--work", str(work)]
    return process(given, command)[:3]


def stage(
    given: Given, work: Path, table: str, dataset: str, read: Callable[[], Any], *words: Any
) -> Run:
    """A stage's command; the work itself is what its log says of its parts."""
    cpu, wall, megabytes = ours(given, work, *words)
    events = logs.last_run(WorkDir(str(work)), dataset, table)
    steady = sum(event["cpu_seconds"] for event in events if event["event"] == "part")
    return Run(cpu, steady, wall, megabytes, read())


def cosines(found: Mapping[str, np.ndarray]) -> dict[str, str]:
    """Least cosine of each with the first one's features."""
    exact = next(iter(found.values()))

    def least(features: np.ndarray) -> float:
        norms = np.linalg.norm(features, axis=1) * np.linalg.norm(exact, axis=1)
        return float(((features * exact).sum(1) / norms).min())

    return {name: f"cosine at least {least(one):.5f}" for name, one in found.items()}
