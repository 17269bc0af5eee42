"""Which lines each test runs and how long it takes, measured once a test file."""

import hashlib
import pickle
import time
from pathlib import Path

import pytest

from .trial import PYTEST


class Contexts:
    """A pytest plugin: a coverage context for each test and each fixture that several share.

    What a shared fixture runs counts for every test that uses it, not for the first alone.
    """

    def __init__(self, coverage):
        self.coverage, self.context = coverage, ""
        self.seconds: dict[str, float] = {}
        self.uses: dict[str, list[str]] = {}
        self.passed: dict[str, bool] = {}

    def _in(self, context: str):
        before, self.context = self.context, context
        self.coverage.switch_context(context)
        return before, time.perf_counter()

    def _out(self, begun) -> None:
        now = time.perf_counter()
        context, (self.context, start) = self.context, begun
        self.seconds[context] = self.seconds.get(context, 0) + now - start
        self.coverage.switch_context(self.context)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        found = item._fixtureinfo.name2fixturedefs
        shared = [f[-1] for name in item.fixturenames if (f := found.get(name))]
        self.uses[item.nodeid] = [_name(f) for f in shared if f.scope != "function"]
        begun = self._in(item.nodeid)
        try:
            return (yield)
        finally:
            self._out(begun)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef):
        if fixturedef.scope == "function":
            return (yield)
        begun = self._in(_name(fixturedef))
        try:
            return (yield)
        finally:
            self._out(begun)

    def pytest_runtest_logreport(self, report):
        fine = report.passed and self.passed.get(report.nodeid, True)
        self.passed[report.nodeid] = fine


def _name(fixturedef) -> str:
    return f"@{fixturedef.baseid}::{fixturedef.argname}"


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def measure(tree: Path, tests: str, out: Path) -> None:
    """Run one test file, in a process of its own, and write what it covers."""
    import coverage

    cover = coverage.Coverage(data_file=None, source=[str(tree / "rsa_data")], config_file=False)
    plugin = Contexts(cover)
    cover.start()
    pytest.main([*PYTEST, tests], plugins=[plugin])
    cover.stop()
    data = cover.get_data()
    lines: dict[str, dict[str, set[int]]] = {}
    for file in data.measured_files():
        name = Path(file).relative_to(tree).as_posix()
        for line, contexts in data.contexts_by_lineno(file).items():
            for context in contexts:
                lines.setdefault(context, {}).setdefault(name, set()).add(line)
    found = {}
    for test in (test for test, fine in plugin.passed.items() if fine):
        contexts, ran = [test, *plugin.uses[test]], {}
        for context in contexts:
            for name, numbers in lines.get(context, {}).items():
                ran.setdefault(name, set()).update(numbers)
        found[test] = sum(plugin.seconds.get(c, 0) for c in contexts), ran
    sources = {Path(f).relative_to(tree).as_posix(): digest(Path(f)) for f in data.measured_files()}
    out.write_bytes(pickle.dumps({"digest": digest(tree / tests), "sources": sources,
                                  "tests": found}))  # fmt: skip


def choose(maps: list[dict], tree: Path, entry: dict, budget: float) -> list[tuple[str, float]]:
    """Tests that run the mutant's lines, the room's own first, fastest first, within `budget` s."""
    file = entry["key"][0]
    room = file.split("/")[1]
    covering, now = {}, digest(tree / file)
    wanted = set(range(entry["start"], entry["end"] + 1))
    for part in maps:
        moved = part["sources"].get(file) != now
        for test, (seconds, ran) in part["tests"].items():
            lines = ran.get(file)
            if lines and (moved or not entry["key"][1] or lines & wanted):
                covering[test] = seconds
    if not covering and not entry["outer"]:  # constants of a module without functions
        covering = {
            test: seconds
            for part in maps
            for test, (seconds, _) in part["tests"].items()
            if test.startswith(f"tests/{room}/")
        }
    order = sorted(covering, key=lambda t: (not t.startswith(f"tests/{room}/"), covering[t]))
    chosen, spent = [], 0.0
    for test in order:
        if chosen and spent + covering[test] > budget:
            break
        chosen.append((test, covering[test]))
        spent += covering[test]
    return chosen
