"""What a benchmark leaves behind: tables of figures in benchmarks/results/NAME.json.

A script calls `table` for each table that it has measured; tables of the same title are replaced,
others of the file stay. Every table carries its own date, machine and versions, since a run may
measure one of them alone. `docs/generate.py` makes docs/performance.md from these files.
"""

import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from rsa_data.runner.cpu import cpu_type

RESULTS = Path(__file__).parents[1] / "results"
PACKAGES = ("rsa-data", "torch", "onnxruntime", "pyarrow", "numpy")


def table(
    name: str,
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[Any]],
    *,
    note: str = "",
    packages: Sequence[str] = (),
    **about: Any,
) -> None:
    """Writes a table of a benchmark.

    name : of the benchmark, without ending. columns : headings. rows : numbers and strings, as many
    as columns. note : sentences on how it was measured and what it does not say. packages : further
    ones whose versions matter. about : whatever else describes the run, such as rounds.
    """
    if wrong := [row for row in rows if len(row) != len(columns)]:
        raise ValueError(f"{name}: expected {len(columns)} values in a row, found {wrong[0]}")
    file = RESULTS / f"{name}.json"
    found = json.loads(file.read_text("utf-8")) if file.is_file() else {}
    versions = {package: version(package) for package in (*PACKAGES, *packages)}
    found[title] = {
        "date": datetime.now(UTC).date().isoformat(),
        "commit": commit(),
        "machine": machine(),
        "versions": {"python": platform.python_version(), **versions},
        **about,
        "note": note,
        "columns": list(columns),
        "rows": [list(row) for row in rows],
    }
    RESULTS.mkdir(exist_ok=True)
    text = json.dumps(found, indent=1, ensure_ascii=False)
    file.write_text(text + "\n", "utf-8")


def update(
    name: str, title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], **how: Any
) -> None:
    """As `table`, but rows of an earlier run stay unless a new one begins with the same value.

    Each row ends with the commit and the load of its own run, which this adds.
    """
    file = RESULTS / f"{name}.json"
    found = json.loads(file.read_text("utf-8")) if file.is_file() else {}
    named = [*columns, "commit", "load"]
    before = found.get(title, {})
    kept = {row[0]: row for row in before.get("rows", []) if before["columns"] == named}
    run = [commit(), round(os.getloadavg()[0])]
    merged = {**kept, **{row[0]: [*row, *run] for row in rows}}
    table(name, title, named, list(merged.values()), **how)


# Runs the rest of its words, and writes CPU seconds, peak kB and status to the file named first.
_LAUNCHER = """
import os, sys
pid = os.posix_spawn(sys.argv[2], sys.argv[2:], os.environ)
_, status, used = os.wait4(pid, 0)
with open(sys.argv[1], "w") as file:
    file.write(f"{used.ru_utime + used.ru_stime} {used.ru_maxrss}")
sys.exit(os.waitstatus_to_exitcode(status) and 1)
"""


def spent(
    command: Sequence[str], env: Mapping[str, str] | None = None
) -> tuple[float, float, float, str]:
    """CPU seconds, wall seconds, peak MB and standard output of a command; exits where it fails.

    env : variables beside those of this process. A process begins with the peak of the one that
    started it (Linux), hence a small one in between.
    """
    with tempfile.TemporaryDirectory() as folder, (Path(folder) / "said").open("w+") as said:
        file, errors = Path(folder) / "used", Path(folder) / "errors"
        launcher = [sys.executable, "-S", "-E", "-c", _LAUNCHER, str(file), *command]
        begun = time.monotonic()
        with errors.open("w") as err:
            done = subprocess.run(
                launcher, env={**os.environ, **(env or {})}, stdout=said, stderr=err, check=False
            )
        wall = time.monotonic() - begun
        if done.returncode:
            sys.exit(f"{' '.join(command[:4])}: {errors.read_text()[-3000:]}")
        cpu, peak = map(float, file.read_text().split())
        said.seek(0)
        return cpu, wall, peak / 1000, said.read()


def machine() -> str:
    """The processor, its cores, and how busy they were when this was asked."""
    names = [
        line.partition(":")[2].strip()
        for line in _lines(Path("/proc/cpuinfo"))
        if line.startswith("model name")
    ]
    flags = {"avx512_bf16", "bf16", "avx512f"} & set(cpu_type().split())
    extras = f" ({', '.join(sorted(flags))})" if flags else ""
    return (
        f"{names[0] if names else platform.machine()}{extras}, {os.cpu_count()} cores, {gpu()}, "
        f"load {os.getloadavg()[0]:.0f} at the end"
    )


def gpu() -> str:
    """The name of the GPU that torch finds, or that there is none."""
    import torch

    return torch.cuda.get_device_name() if torch.cuda.is_available() else "no GPU"


def commit() -> str:
    """The commit of this checkout, and whether files but the results differ from it."""
    git = ["git", "-C", str(RESULTS.parent)]
    words = [*git, "describe", "--always", "--exclude=*"]
    name = subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()
    words = [*git, "diff", "--quiet", "HEAD", "--", ":/", ":(exclude)results"]
    same = subprocess.run(words, capture_output=True, check=False).returncode == 0
    return (name if same else f"{name}-dirty") if name else "unknown"


def version(package: str) -> str:
    """The installed version of a package, "-" without it."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "-"


def _lines(path: Path) -> list[str]:
    return path.read_text().splitlines() if path.is_file() else []
