"""Coverage-guided fuzzing of every importer of text and JSON: no error but the project's own.

    pip install atheris     # wheels for Linux; in no extra, since nothing else needs it
    python benchmarks/fuzz.py [--seconds 60] [--only NAME ...] [--corpus DIR] [--record]

Each importer runs in a process of its own for so many seconds, through its public door, on inputs
that atheris makes of real and hand-written files: bytes and words change in text, places in the
tree in JSON, so that most inputs get past the parser. Code of rsa_data and tomllib is instrumented.
For each importer: inputs tried, edges and features covered at the beginning and at the end, errors
that are not the project's own (none may be), CPU time of the slowest input, and peak memory, most
of which is what is imported. --corpus keeps what reached something new, for the next time.
"""

import argparse
import copy
import json
import os
import random
import re
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
import recording

TITLE = "Inputs tried by each fuzzed importer"
COLUMNS = ("importer", "seconds", "inputs", "edges at first", "edges at the end", "errors",
           "slowest, CPU s", "peak MB")  # fmt: skip
LONGEST = 16_384  # bytes of an input

# What goes wrong more often than chance would find: in text, and as JSON.
WORDS = ["nan", "inf", "-1", "1e999", "0", "1" * 30, "..", "/", "a/../../b", "\0", "\u2028",
         "\ud800", "a" * 300, "None", ",", ":", '"', "[", "{", "#", "\r", "\ufeff"]  # fmt: skip
VALUES: list[Any] = [None, True, False, 0, 1, -1, 3, 60_000, 2**31, 2**53, 2**63, 2**64, 10**400,
                     0.5, -0.5, 1e308, -0.0, float("nan"), float("inf"), "", [], {}, [[]], [None],
                     {"": 0}, [0, 0, 2, 2], [1e9] * 6]  # fmt: skip


def places(value: Any, where: tuple = ()) -> list[tuple]:
    """The path of every value inside a JSON value."""
    if not isinstance(value, (dict, list)):
        return [where]
    inner = value.items() if isinstance(value, dict) else enumerate(value)
    return [where, *(p for key, v in inner for p in places(v, (*where, key)))]


def mutate_text(text: str, rng: random.Random) -> str:
    """One word or line replaced, doubled, taken out, or joined with another."""
    pieces = re.split(r"(\s+|[=,:\[\]{}\"])" if rng.random() < 0.7 else r"(\n)", text)
    at = rng.randrange(len(pieces))
    kind = rng.randrange(4)
    if kind == 0:
        pieces[at] = rng.choice(WORDS)
    elif kind == 1:
        pieces[at] = rng.choice(pieces)
    elif kind == 2:
        pieces[at:at] = pieces[max(0, at - rng.randrange(5)) : at + 1]
    else:
        del pieces[at : at + rng.randrange(1, 4)]
    return "".join(pieces)


def mutate_json(value: Any, rng: random.Random) -> Any:
    """One place of a JSON value replaced, moved, doubled, nudged or taken out."""
    there = places(value)
    where = rng.choice(there)
    if not where:
        return copy.deepcopy(rng.choice(VALUES)) if rng.random() < 0.05 else value
    parent = value
    for key in where[:-1]:
        parent = parent[key]
    key, old = where[-1], parent[where[-1]]
    kind = rng.randrange(6)
    if kind == 0:
        del parent[key]
    elif kind == 1 and isinstance(old, str):
        parent[key] = mutate_text(old, rng)
    elif kind == 1 and isinstance(old, (int, float)) and not isinstance(old, bool):
        parent[key] = rng.choice([old + 1, -old, old * 2, str(old), [old]])
    elif kind == 2 and isinstance(parent, list):
        parent.insert(key, old)
    elif kind == 2:
        parent[rng.choice(WORDS)] = parent.pop(key)
    elif kind == 3:
        other = value  # a copy of it, as a tree must not hold itself
        for step in rng.choice(there):
            other = other[step]
        parent[key] = copy.deepcopy(other)
    else:
        parent[key] = copy.deepcopy(rng.choice(VALUES if rng.random() < 0.7 else WORDS))
    return value


def mutator(kind: str, anew: bytes, change: Callable[[bytes, int], bytes]) -> Callable:
    """A custom mutator for atheris. anew : an input to begin with; change : the fuzzer's own."""

    def mutate(data: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if rng.random() < 0.2:
            return change(data, most)
        made = data
        if kind == "json":
            try:
                value = json.loads(data)
            except (ValueError, RecursionError):
                value = json.loads(anew)
            for _ in range(rng.choice((1, 1, 2, 4))):
                value = mutate_json(value, rng)
            made = json.dumps(value).encode()
        else:
            text = data.decode("utf-8", "replace")
            for _ in range(rng.choice((1, 1, 2, 4))):
                text = mutate_text(text, rng)
            made = text.encode("utf-8", "surrogatepass")
        return made if len(made) <= most else change(data, most)

    return mutate


def keep(error: BaseException, data: bytes, found: Path) -> None:
    """Writes an error that must not be, with the smallest input that leads there."""
    frames = traceback.extract_tb(error.__traceback__)
    inner = [f for f in frames if "rsa_data" in f.filename] or frames[-1:]
    last = inner[-1]
    name = f"{type(error).__name__}-{Path(last.filename).stem}-{last.lineno}"
    place = found / name
    if not place.exists() or len(data) < place.stat().st_size:
        place.write_bytes(data)
        trace = "".join(traceback.format_exception(error))
        (found / f"{name}.trace").write_text(trace, "utf-8", "backslashreplace")


def child(name: str, here: Path, corpus: Path, seconds: int) -> None:
    """Fuzzes one importer in this process; libFuzzer ends it."""
    import atheris

    # Never left: what is imported on first use counts as well.
    atheris.instrument_imports(include=["rsa_data", "tomllib"]).__enter__()
    import fuzzing as importers

    from rsa_data.common.errors import RsaDataError

    importer = importers.IMPORTERS[name]
    (here / "work").mkdir()
    (here / "found").mkdir()
    one = importer.make(here / "work")
    seeds = importer.seeds()
    for number, seed in enumerate(seeds):
        (corpus / f"seed-{number}").write_bytes(seed[:LONGEST])
    slowest = 0.0

    def run(data: bytes) -> None:
        nonlocal slowest
        begun = time.process_time()
        try:
            one(data)
        except RsaDataError:
            pass
        except BaseException as error:  # also a panic of Rust code, which is no Exception
            if isinstance(error, KeyboardInterrupt):
                raise
            keep(error, data, here / "found")
        if (took := time.process_time() - begun) > slowest:
            slowest = took
            (here / "slowest").write_bytes(data)
            (here / "slowest-seconds").write_text(f"{took:.3f}")

    words = [sys.argv[0], f"-max_total_time={seconds}", f"-max_len={LONGEST}", "-timeout=60"]
    words += ["-rss_limit_mb=6000", "-print_final_stats=1", f"-artifact_prefix={here}/died-"]
    # atheris.Mutate is another function once Setup has chosen its libFuzzer.
    mutate = mutator(importer.kind, seeds[0], lambda data, most: atheris.Mutate(data, most))
    atheris.Setup([*words, str(corpus)], run, custom_mutator=mutate)
    atheris.Fuzz()


def fuzz(name: str, here: Path, corpus: Path, seconds: int, record: bool) -> bool:
    """Fuzzes one importer in a process of its own and prints what came of it; True when clean."""
    corpus.mkdir(parents=True, exist_ok=True)
    words = [sys.executable, __file__, "--child", name, str(here), str(corpus), str(seconds)]
    environment = os.environ | {"PYTHONWARNINGS": "ignore", "XDG_CACHE_HOME": str(here / "cache")}
    with (here / "log").open("wb") as log:
        ended = subprocess.run(words, stdout=log, stderr=log, env=environment)
    text = (here / "log").read_text("utf-8", "replace")
    covered = re.findall(r"(?:INITED|DONE)\s+cov: (\d+) ft: (\d+)", text)
    stats = dict(re.findall(r"stat::(\w+):\s+(\d+)", text))
    traces = sorted((here / "found").glob("*.trace"))
    died = sorted(here.glob("died-*"))
    if ended.returncode or len(covered) < 2:
        print(f"{name}: ended with {ended.returncode}; {text[-300:]}", flush=True)
    first, last = (covered * 2)[:2] if covered else [("?", "?")] * 2
    slowest = here / "slowest-seconds"
    tried = int(stats.get("number_of_executed_units", 0))
    print(
        f"{name:16} {tried:>9,} inputs, edges {first[0]} to {last[0]}, features {first[1]} to "
        f"{last[1]}, errors {len(traces) + len(died)}, slowest "
        f"{slowest.read_text() if slowest.exists() else '?'} s, "
        f"peak {stats.get('peak_rss_mb', '?')} MB",
        flush=True,
    )
    if record:
        taken = slowest.read_text() if slowest.exists() else "?"
        row = [name, seconds, tried, first[0], last[0], len(traces) + len(died), taken]
        recording.update("fuzz", TITLE, COLUMNS, [[*row, stats.get("peak_rss_mb", "?")]])
    for path in died:
        print(f"--- {name}: {path.name}: {path.read_bytes()[:500]!r}")
    for trace in traces:
        data = trace.with_suffix("").read_bytes()
        print(f"--- {name}: {len(data)} bytes: {data[:500]!r}\n{trace.read_text('utf-8')[-1500:]}")
    return not (ended.returncode or traces or died)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--only", nargs="+", metavar="NAME")
    parser.add_argument("--corpus", type=Path)
    parser.add_argument("--record", action="store_true", help="keep the figures")
    parser.add_argument("--child", nargs=4, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        name, here, corpus, seconds = given.child
        child(name, Path(here), Path(corpus), int(seconds))
        return 0
    import fuzzing as importers

    clean = True
    for name in given.only or importers.IMPORTERS:
        with tempfile.TemporaryDirectory(prefix="rsa-data-fuzz-") as folder:
            here = Path(folder)
            corpus = (given.corpus or here / "corpus") / name
            clean &= fuzz(name, here, corpus, given.seconds, given.record)
    return 0 if clean else 1


if __name__ == "__main__":
    sys.exit(main())
