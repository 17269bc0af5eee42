"""Do the tests notice a changed number? Small faults, one at a time, and the tests that run them.

    pip install -e ".[dev,mutation]"
    python benchmarks/mutation.py [--state DIR] [--minutes 8]

cosmic-ray makes the mutants: a comparison, an operator, a constant, a condition, in captions,
depth, evaluation, heads, store, the decoders of segments, and two modules that they stand on. Of
all places where the code can be changed so, 520 are drawn with a seed, and one mutant at each.
The tests of these rooms run once with coverage; then each mutant is written into a copy of the
tree, and the tests that run its lines are run on it, fastest first, until one fails or 60 s of
tests have passed. A time limit of a few times the normal time counts as caught. The code as it is
is tried too, as a control: its tests must pass.

Call it until it says that nothing is left: each call goes on where the last one stopped, after so
many minutes at most. Where the code of a mutant has changed since, another one is drawn. It writes
benchmarks/results/mutation.json and mutation.md: what was caught, and the survivors, each with its
reason from benchmarks/mutating/survivors.toml.
--again tries the survivors that have no reason once more, with tests that are new since. The
folder ../shared is not beside the copy, so tests that need it are skipped: the figures are those
of any checkout.
"""

import argparse
import json
import pickle
import subprocess
import sys
import time
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

# Test files that are measured: those of the rooms, of the modules that they stand on, and of what
# reads and writes through the store.
TESTS = ("tests/captions", "tests/depth", "tests/evaluation", "tests/heads", "tests/segments",
         "tests/store", "tests/datasets/test_datasets.py", "tests/datasets/test_nyuv2_labeled.py",
         "tests/datasets/test_roots.py", "tests/datasets/test_far_shards.py",
         "tests/datasets/test_shards.py",
         "tests/runner/test_runs.py")  # fmt: skip
BUDGET = 60.0  # seconds of normal time that the tests of one mutant may take
RESULTS = ROOT / "benchmarks" / "results"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--state", type=Path, default=Path("/tmp/rsa-data-mutation"))
    parser.add_argument("--minutes", type=float, default=8.0, help="stop after so long")
    parser.add_argument("--mutants", type=int, default=520)
    parser.add_argument("--seed", type=int, default=16)
    parser.add_argument("--again", action="store_true", help="try the survivors again")
    options = parser.parse_args()
    begun = time.monotonic()
    early, deadline = begun + 6 * options.minutes, begun + 60 * options.minutes

    from mutating import trial

    state = options.state.resolve()
    tree = state / "tree"
    (state / "cover").mkdir(parents=True, exist_ok=True)
    trial.copied(ROOT, tree)
    trial.load_libraries()
    cover(state, tree, early)
    drawn = state / f"sample-{options.seed}.json"
    if not drawn.exists():
        draw(tree, options, drawn)
    follow(tree, options, drawn)
    left = test_all(state, tree, drawn, options.again, deadline)
    report(drawn)
    print(f"{left} left: call again" if left else "nothing is left")


def cover(state: Path, tree: Path, deadline: float) -> None:
    """Measure the test files that are new or changed, until the deadline."""
    from mutating import covering, trial

    for tests in test_files(tree):
        out = map_of(state, tests)
        if out.exists():
            known = pickle.loads(out.read_bytes())
            if known["digest"] == covering.digest(tree / tests):
                continue
        if time.monotonic() > deadline:
            return
        log = out.with_suffix(".log")
        begun = time.monotonic()

        def work(tests=tests, out=out) -> int:
            covering.measure(tree, tests, out)
            return 0

        status = trial.forked(tree, log, 900, work)
        print(f"covered {tests}: {time.monotonic() - begun:.0f} s, status {status}", flush=True)
        if status != 0:
            sys.exit(f"{tests} could not be measured, see {log}")


def map_of(state: Path, tests: str) -> Path:
    return state / "cover" / f"{tests.replace('/', '+')}.pickle"


def test_files(tree: Path) -> list[str]:
    found = []
    for name in TESTS:
        place = tree / name
        found += sorted(place.glob("test_*.py")) if place.is_dir() else [place]
    return [path.relative_to(tree).as_posix() for path in found]


def draw(tree: Path, options: argparse.Namespace, drawn: Path) -> None:
    from mutating import places

    found = [entry(m) for m in places.sample(tree, options.mutants, options.seed)]
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, check=True,
                            capture_output=True, text=True).stdout.strip()  # fmt: skip
    about = {"seed": options.seed, "commit": commit, "mutants": found, "controls": []}
    drawn.write_text(json.dumps(about, indent=1))


def entry(mutant) -> dict:
    """What is kept of a mutant, by which it is found again."""
    kept = ("key", "operator", "nth", "line", "column", "start", "end", "outer")
    return {name: getattr(mutant, name) for name in kept}


def follow(tree: Path, options: argparse.Namespace, drawn: Path) -> None:
    """Find the mutants again in code that has changed; others are drawn for those that are gone."""
    from mutating import places

    about = json.loads(drawn.read_text())
    mutants = about["mutants"]
    wanted = {None, "slow"} | ({"survived"} if options.again else set())
    for m in mutants:
        if m.get("outcome") in wanted:
            there = places.find(tree, m)
            m |= {"outcome": "gone"} if there is None else entry(there)
    short = options.mutants - sum(m.get("outcome") != "gone" for m in mutants)
    if short > 0:
        known = {tuple(m["key"]) for m in mutants}
        more = places.sample(tree, options.mutants, options.seed)
        mutants += [entry(m) for m in more if m.key not in known][:short]
    drawn.write_text(json.dumps(about, indent=1))


def test_all(state: Path, tree: Path, drawn: Path, again: bool, deadline: float) -> int:
    """Try what has no result yet; returns how many are left when the time is over."""
    from mutating import covering, places, session, trial

    measured = [t for t in test_files(tree) if map_of(state, t).exists()]
    maps = [pickle.loads(map_of(state, t).read_bytes()) for t in measured]
    # Rooms whose tests are not all measured have to wait.
    later = {t.split("/")[1] for t in test_files(tree) if t not in measured}
    about = json.loads(drawn.read_text())
    mutants = about["mutants"]
    wanted = {None, "slow"} | ({"survived"} if again else set())
    known = reasons()

    def left(slow: bool = False) -> list[tuple[int, list[tuple[str, float]]]]:
        """What can be tried now, cheapest first: place in the list of mutants, its tests."""
        found = []
        for number, m in enumerate(mutants):
            stays = m.get("outcome") == "survived" and (m.get("again") or tuple(m["key"]) in known)
            if m.get("outcome") in wanted and not stays and m["key"][0].split("/")[1] not in later:
                alone = not m["outer"] or m.get("outcome") == "slow"
                if alone == slow:
                    found.append((number, covering.choose(maps, tree, m, BUDGET)))
        return sorted(found, key=lambda f: sum(seconds for _, seconds in f[1][:3]))

    def todo():
        for done, (number, tests) in enumerate(left()):
            if time.monotonic() > deadline - 60:
                return
            if done % 40 == 0:
                yield -1, None, tests
            yield number, places.find(tree, mutants[number]), tests

    def take(number: int, result: dict) -> None:
        if number < 0:
            about["controls"].append(result)
            return
        if again and result["outcome"] != "slow":
            result["again"] = True
            if result["outcome"] == "caught":
                result["added"] = True
        mutants[number].update(result)

    out = state / "trials.jsonl"
    out.unlink(missing_ok=True)
    log, limit = state / "session.log", deadline - time.monotonic() + 300
    trial.forked(tree, log, limit, lambda: session.run(tree, state, measured, todo, out))
    for line in out.read_text().splitlines() if out.exists() else []:
        take(*json.loads(line))
    drawn.write_text(json.dumps(about, indent=1))
    for number, tests in left(slow=True):
        if time.monotonic() > deadline:
            break
        mutant = places.find(tree, mutants[number])
        with trial.changed(tree / mutant.file, mutant.code):
            take(number, trial.tried(tree, tests, state) | {"tests": len(tests)})
        drawn.write_text(json.dumps(about, indent=1))
    return sum(m.get("outcome") in (None, "slow") for m in mutants)


def reasons() -> dict[tuple[str, str, str, str], str]:
    """Why a survivor stays, by its file, function, and its line before and after."""
    told = tomllib.loads((ROOT / "benchmarks/mutating/survivors.toml").read_text("utf-8"))
    return {(s["file"], s["function"], s["before"], s["after"]): s["reason"]
            for s in told.get("survivor", [])}  # fmt: skip


def report(drawn: Path) -> None:
    """Write the results; a survivor without a reason is listed as open."""
    about = json.loads(drawn.read_text())
    tried = [m for m in about["mutants"] if m.get("outcome") in ("caught", "survived")]
    if not tried:
        return
    survivors = [m for m in tried if m["outcome"] == "survived"]
    at_first = len(survivors) + sum(bool(m.get("added")) for m in tried)
    known = reasons()
    controls = [c["outcome"] for c in about["controls"]]
    figures = {
        "seed": about["seed"],
        "commit": about["commit"],
        "mutants": len(tried),
        "caught": len(tried) - len(survivors),
        "share_caught": round(1 - len(survivors) / len(tried), 4),
        "share_caught_before_the_tests_that_it_led_to": round(1 - at_first / len(tried), 4),
        "controls": len(controls),
        "controls_that_passed": controls.count("survived"),
        "drawn_but_not_tried_yet": sum("outcome" not in m for m in about["mutants"]),
        "gone_or_broken": sum(m.get("outcome") in ("gone", "error") for m in about["mutants"]),
        "seconds": round(sum(m["seconds"] for m in tried)),
    }
    rooms: dict[str, list[int]] = {}
    for mutant in tried:
        count = rooms.setdefault(mutant["key"][0].split("/")[1], [0, 0])
        count[0] += 1
        count[1] += mutant["outcome"] == "caught"
    suffix = "" if about["seed"] == 16 else f"_{about['seed']}"
    every = [{"file": m["key"][0], "function": m["key"][1], "before": m["key"][2],
              "after": m["key"][3], "operator": m["operator"], "outcome": m["outcome"],
              "by": m["by"]} for m in tried]  # fmt: skip
    written = json.dumps({**figures, "rooms": rooms, "tried": every}, indent=1)
    (RESULTS / f"mutation{suffix}.json").write_text(f"{written}\n", "utf-8")
    text = ["# Mutants that the tests let pass\n", "Written by benchmarks/mutation.py.\n"]
    text += [f"- {name.replace('_', ' ')}: {value}" for name, value in figures.items()]
    if figures["drawn_but_not_tried_yet"]:
        text.append(
            "\nThe run is not finished. Those whose tests take least time were tried first, those "
            "that no test runs among them, so the share is not yet that of the sample."
        )
    text += ["", "| room | mutants | caught |", "|---|---|---|"]
    text += [f"| {room} | {n} | {caught} |" for room, (n, caught) in sorted(rooms.items())]
    for m in sorted(survivors, key=lambda m: m["key"]):
        file, function, before, after = m["key"]
        text += ["", f"## {file}{':' + function if function else ''}", "", "```diff",
                 f"- {before}", f"+ {after}", "```", "",
                 known.get((file, function, before, after))
                 or f"OPEN: {m['by'] or 'no reason yet'}."]  # fmt: skip
    (RESULTS / f"mutation{suffix}.md").write_text("\n".join(text) + "\n", "utf-8")
    print(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
