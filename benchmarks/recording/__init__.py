"""What a benchmark leaves behind: tables of figures in benchmarks/results/NAME.json.

A script calls `table` for each table that it has measured; tables of the same title are replaced,
others of the file stay. Every table carries its own date, machine and versions, since a run may
measure one of them alone. `docs/generate.py` makes docs/performance.md from these files.
"""

import json
import os
import platform
import subprocess
from collections.abc import Sequence
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
