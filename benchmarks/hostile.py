"""Attacks every surface of the command line and counts what comes of it.

    python benchmarks/hostile.py [--surface NAME ...] [--only PATTERN] [--jobs 2] [--out FILE]
    python benchmarks/hostile.py --record       # into benchmarks/results/hostile.json

An attack is a hostile file, work dir, server or call. It must be refused with an error that
explains it, end in a failed row, or do no harm where the attack says that it may. Counted for each
surface: attacks, refusals, failed rows, harmless ones, tracebacks (also death by a signal), hangs
over the deadline, and wrong acceptances (also: a refusal for another reason, a control character on
the terminal, a key on disk or at another server, more than 1.5 GB of memory, a file outside).
Each attack runs in a process of its own: forked with the packages imported, so that its memory is
this attack's; the signals' ones are started from nothing. Ends with status 1 unless the last three
are 0.
"""

import argparse
import json
import re
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import recording
from attacks import harness
from attacks.world import World

SURFACES = ("workdir", "heads", "images", "annotations", "onnx", "text", "roots", "vlm", "play",
            "objects", "commands", "signals")  # fmt: skip
COUNTS = ("refused", "failed", "accepted", "traceback", "hang", "wrong")

TITLE = "Attacks on each surface, and what came of them"
COLUMNS = ("surface", "attacks", "refused", "failed rows", "harmless", "tracebacks", "hangs",
           "wrongly accepted", "broken attacks", "peak MB", "slowest, s", "all, s")  # fmt: skip
NOTE = (
    "The last run of each surface, of the commit in its row. Harmless: accepted where that is "
    "right. Wrongly accepted counts everything else that must not be, such as more than 1.5 GB of "
    "memory. Peak memory is that of the largest process, about 300 MB of which are imports."
)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--surface", nargs="+", choices=SURFACES, default=SURFACES)
    parser.add_argument("--only", help="attacks whose name matches")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--record", action="store_true", help="keep the figures of each surface")
    parser.add_argument("--show", action="store_true", help="print what each command printed")
    given = parser.parse_args()
    table: dict[str, dict[str, float]] = {}
    with (
        tempfile.TemporaryDirectory(prefix="rsa-data-hostile-") as folder,
        World(Path(folder)) as world,
    ):
        for surface in given.surface:
            table[surface] = attack(surface, world, given)
            if given.record and not given.only:
                row = [surface, *table[surface].values()]
                recording.update("hostile", TITLE, COLUMNS, [row], note=NOTE)
    for name, row in table.items():
        print(f"{name:12} " + "  ".join(f"{key} {value:g}" for key, value in row.items()))
    attacks = sum(int(row["attacks"]) for row in table.values())
    bad = sum(
        row[key] for row in table.values() for key in ("traceback", "hang", "wrong", "broken")
    )
    print(f"{attacks} attacks, {bad:g} of them not held")
    if given.out:
        given.out.write_text(json.dumps(table, indent=1) + "\n")
    return 1 if bad else 0


def attack(surface: str, world: World, given: argparse.Namespace) -> dict[str, float]:
    """Runs a surface's attacks and prints those that were not held."""
    attacks = [
        one
        for one in import_module(f"attacks.{surface}").attacks(world)
        if not given.only or re.search(given.only, one.name)
    ]
    names = [one.name for one in attacks]
    assert len(names) == len(set(names)), sorted(n for n in names if names.count(n) > 1)
    row: dict[str, float] = dict.fromkeys(("attacks", *COUNTS, "broken"), 0)
    peak = seconds = 0.0
    begun = time.monotonic()
    for result in harness.run(attacks, given.jobs, world.place / surface):
        row["attacks"] += 1
        row["wrong" if result.wrong else result.outcome] += 1
        peak, seconds = max(peak, result.peak), max(seconds, result.seconds)
        bad = result.wrong or result.outcome in ("traceback", "hang", "broken")
        if bad or given.show:
            print(f"--- {surface}: {result.attack.name}: {result.wrong or result.outcome} "
                  f"({result.seconds:.1f} s, {result.peak / 1e6:.0f} MB)")  # fmt: skip
            print("    rsa-data " + " ".join(result.attack.words)[:300])
            print("    " + ascii(result.text[-1200:]).replace("\\n", "\n    "), flush=True)
    row["peak_mb"], row["slowest_s"] = round(peak / 1e6), round(seconds, 1)
    row["all_s"] = round(time.monotonic() - begun)
    return row


if __name__ == "__main__":
    sys.exit(main())
