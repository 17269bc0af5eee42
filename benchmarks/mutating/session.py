"""Many trials from one pytest session: everything is imported and collected once, then forked.

A mutant inside a function is tried so: the child gives the function the changed code and runs the
chosen tests. What runs on import (constants, decorators, defaults) needs a session of its own, see
trial.py.
"""

import contextlib
import gc
import json
import os
import resource
import shutil
import signal
import sys
import time
import types
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from .places import Mutant
from .trial import MEMORY, PYTEST, changed

# What is to be tried next: a place in the list of mutants, the mutant (None: the code as it is, a
# control), its tests and their seconds.
Todo = Iterator[tuple[int, Mutant | None, list[tuple[str, float]]]]


class Trials:
    """A pytest plugin that runs trials in place of the tests."""

    def __init__(self, tree: Path, scratch: Path, todo: Callable[[], Todo], out: Path):
        self.tree, self.scratch, self.todo, self.out = tree, scratch, todo, out
        self.failed = ""
        self.functions: dict[tuple[str, str], list[types.FunctionType]] = {}

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session):
        items = {item.nodeid: item for item in session.items}
        for found in gc.get_objects():
            if type(found) is types.FunctionType:  # isinstance asks lazy modules
                where = found.__code__.co_filename, found.__code__.co_qualname
                self.functions.setdefault(where, []).append(found)
        gc.freeze()  # so that collecting garbage in a child copies no page
        for number, mutant, tests in self.todo():
            chosen = [items[name] for name, _ in tests if name in items]
            limit = 20 + 4 * sum(seconds for _, seconds in tests)
            begun = time.monotonic()
            if mutant is None:
                result = self.trial(chosen, None, limit)
            else:
                with changed(self.tree / mutant.file, mutant.code):
                    result = self.trial(chosen, mutant, limit)
            result |= {"seconds": round(time.monotonic() - begun, 2), "tests": len(chosen)}
            with self.out.open("a") as file:
                file.write(json.dumps([number, result]) + "\n")
        return True

    def trial(self, items: list, mutant: Mutant | None, limit: float) -> dict[str, str]:
        if not items:
            return {"outcome": "survived", "by": "no test runs it"}
        first = self.scratch / "first"
        first.unlink(missing_ok=True)
        shutil.rmtree(self.scratch / "base", ignore_errors=True)
        child = os.fork()
        if child == 0:
            status = 70
            try:
                os.setsid()
                resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
                status = self.run(items, mutant, first)
            finally:
                os._exit(status)
        end, status = time.monotonic() + limit, None
        while status is None and time.monotonic() < end:
            done, ended = os.waitpid(child, os.WNOHANG)
            if done:
                status = os.waitstatus_to_exitcode(ended)
            else:
                time.sleep(0.01)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(child, signal.SIGKILL)
        if status is None:
            os.waitpid(child, 0)
            return {"outcome": "caught", "by": "time limit"}
        if status == 0:
            return {"outcome": "survived", "by": ""}
        if status == 3:
            return {"outcome": "slow", "by": ""}
        if first.exists():
            return {"outcome": "caught", "by": first.read_text()}
        if status < 0:
            return {"outcome": "caught", "by": f"signal {-status}"}
        return {"outcome": "error", "by": f"exit {status}"}

    def run(self, items: list, mutant: Mutant | None, first: Path) -> int:
        if mutant is not None and not self.replaced(self.tree / mutant.file, mutant):
            return 3
        for item, after in zip(items, [*items[1:], None], strict=True):
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
            if self.failed:
                first.write_text(self.failed)
                return 1
        return 0

    def replaced(self, path: Path, mutant: Mutant) -> bool:
        """Give the live function the mutant's code; False where there is no such function.

        A module that is not loaded yet needs nothing: it will be read from the changed file.
        """
        if not any(getattr(m, "__file__", None) == str(path) for m in list(sys.modules.values())):
            return True
        found = [code for code in codes(compile(mutant.code, str(path), "exec"))
                 if code.co_qualname == mutant.outer]  # fmt: skip
        functions = self.functions.get((str(path), mutant.outer), [])
        if len(found) != 1 or not functions:
            return False
        for function in functions:
            function.__code__ = found[0]
        return True

    def pytest_runtest_logreport(self, report):
        if report.failed:
            self.failed = self.failed or report.nodeid


def codes(code: types.CodeType) -> Iterator[types.CodeType]:
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield constant
            yield from codes(constant)


def run(tree: Path, scratch: Path, files: list[str], todo: Callable[[], Todo], out: Path) -> int:
    """In a process of its own: collect the test files, then try what `todo` gives."""
    sys.dont_write_bytecode = True
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    options = [*PYTEST, f"--basetemp={scratch / 'base'}"]
    return pytest.main([*options, *files], plugins=[Trials(tree, scratch, todo, out)])
