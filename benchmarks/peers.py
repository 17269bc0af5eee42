"""This project against what people would take instead: the same work, both sides in one run.

    python benchmarks/peers.py [--rows minilm,clip,...] [--rounds 3] [--more] [--threads 1]
        [--peer-python PYTHON] [--minilm DIR] [--folder DIR]

Every run is a process of its own; rounds of all ways alternate; figures are medians. What is
compared are CPU seconds of whole processes (start, reading and writing included) and of the work
alone, so that other work on the machine counts little; with one thread they add up to the time on
a free core. With more threads it is wall seconds of whole processes too, which mean something on
free cores alone; those tables have names of their own. Both sides get the same files and threads,
and what they find is compared.

--peer-python : a Python with the packages of the extra `peers`; some of them want other versions
    of packages than this project, so that a virtual environment of its own is the safe way.
--minilm : all-MiniLM-L6-v2 with onnx/model.onnx beside model.safetensors.
--shared : real data: models/yolox_nano.onnx, rgbd/ with photos and depth maps, and
    rsa_release/nyu-{train,test}.tar.xz, the folder `text` of the RSA repository.
--more : add rounds to those of the last run on the same machine with the same versions.
--small : a tiny amount of work, to see that everything runs; writes no results.
"""

import argparse
import compileall
import importlib
import json
import math
import statistics
import subprocess
import sys
import tempfile
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))
sys.path.insert(0, str(Path(__file__).parent))

import recording
from peer_rows.ways import Given, Row, Run

import rsa_data

SHARED = Path(__file__).parents[2] / "shared" / "data"
ROWS = {
    "minilm": "texts:minilm",
    "clip": "texts:clip",
    "images": "images:embedding",
    "captions": "captions:row",
    "reading": "training:reading",
    "detection": "images:detection",
    "training": "training:training",
    "evaluation": "evaluation:row",
}
_COLUMNS = (
    "way",
    "CPU s, whole",
    "a second",
    "times the best peer",
    "CPU s, work alone",
    "times the best peer (work alone)",
    "wall s, whole",
    "times the best peer (wall)",
    "peak MB",
    "result",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rows", default=",".join(ROWS), help=f"of {', '.join(ROWS)}")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--more", action="store_true")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--small", action="store_true")
    parser.add_argument("--peer-python", default=sys.executable)
    parser.add_argument("--minilm", type=Path)
    parser.add_argument("--texts-of", type=int, default=545, help="images whose captions are taken")
    parser.add_argument("--shared", type=Path, default=SHARED)
    parser.add_argument("--folder", type=Path, help="where prepared work stays between runs")
    given = parser.parse_args()
    # As pip does when it installs a package; a checkout may have no bytecode.
    compileall.compile_dir(Path(rsa_data.__file__).parent, quiet=1)
    if not given.shared.is_dir():
        sys.exit(
            f"--shared: expected a folder of real data (see the docstring); none at {given.shared}"
        )
    if unknown := set(given.rows.split(",")) - set(ROWS):
        sys.exit(f"--rows: expected some of {', '.join(ROWS)}; found {', '.join(unknown)}")
    place: Any = (
        tempfile.TemporaryDirectory() if given.folder is None else nullcontext(given.folder)
    )
    with place as name:
        folder = Path(name).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        for key in given.rows.split(","):
            module, _, function = ROWS[key].partition(":")
            how = Given(
                folder,
                given.peer_python,
                given.threads,
                given.shared,
                given.small,
                {"minilm": given.minilm, "images": given.texts_of},
            )
            row: Row = getattr(importlib.import_module(f"peer_rows.{module}"), function)(how)
            if given.threads > 1:
                row = replace(row, title=f"{row.title}, {given.threads} threads")
            measure(row, given)


def measure(row: Row, given: argparse.Namespace) -> None:
    """Alternating rounds of a row; writes its table."""
    runs: dict[str, list[list[float]]] = earlier(row) if given.more else {}
    found: dict[str, Any] = {}
    for number in range(given.rounds):
        for way in row.ways:
            run: Run = way.run()
            runs.setdefault(way.name, []).append([run.cpu, run.steady, run.wall, run.megabytes])
            found[way.name] = run.found
            print(f"{row.title}, round {number + 1}: {way.name}: {run.cpu:.1f} s of CPU, "
                  f"{run.steady:.1f} s the work alone, {run.wall:.0f} s", flush=True)  # fmt: skip
    rows = table(row, runs, row.agree(found))
    for line in rows:
        print("  ".join(str(value) for value in line))
    if not given.small:
        recording.table(
            "peers",
            row.title,
            _COLUMNS,
            rows,
            note=f"{row.count:,} {row.unit}. {row.note}",
            packages=("datasets", "webdataset", "pandas", "scipy"),
            peers=their_versions(given.peer_python),
            threads=given.threads,
            rounds=min(map(len, runs.values())),
            runs=runs,
        )


def their_versions(python: str) -> str:
    """Versions of packages that the peers' Python has."""
    names = ("sentence-transformers", "transformers", "optimum", "fastembed", "open-clip-torch",
             "supervision", "torch", "onnxruntime")  # fmt: skip
    code = (
        "import sys; from importlib.metadata import version\n"
        "for name in sys.argv[1:]:\n"
        "    try: print(name, version(name))\n"
        "    except Exception: pass"
    )
    said = subprocess.run([python, "-c", code, *names], capture_output=True, text=True, check=True)
    return ", ".join(said.stdout.split("\n")[:-1])


def earlier(row: Row) -> dict[str, list[list[float]]]:
    """The runs of the ways that an earlier call has recorded."""
    file = recording.RESULTS / "peers.json"
    content = json.loads(file.read_text()) if file.is_file() else {}
    runs: dict[str, list[list[float]]] = content.get(row.title, {}).get("runs", {})
    # A run of an older version has no wall seconds.
    return {way.name: [r for r in runs.get(way.name, []) if len(r) == 4] for way in row.ways}


def table(
    row: Row, runs: dict[str, list[list[float]]], agree: Any
) -> list[list[float | str | None]]:
    """A line for each way, of medians."""
    medians = {
        name: [statistics.median(column) for column in zip(*done, strict=True)]
        for name, done in runs.items()
    }
    theirs = [medians[way.name] for way in row.ways if not way.ours]
    best = [min(column) for column in zip(*theirs, strict=True)]

    def times(index: int, seconds: float) -> float | None:
        return None if math.isnan(seconds) else round(best[index] / seconds, 2)

    return [
        [
            way.name,
            round(medians[way.name][0], 2),
            round(row.count / medians[way.name][0], 1),
            times(0, medians[way.name][0]),
            None if math.isnan(medians[way.name][1]) else round(medians[way.name][1], 2),
            times(1, medians[way.name][1]),
            round(medians[way.name][2], 2),
            times(2, medians[way.name][2]),
            round(medians[way.name][3]),
            agree[way.name],
        ]
        for way in row.ways
    ]


if __name__ == "__main__":
    main()
