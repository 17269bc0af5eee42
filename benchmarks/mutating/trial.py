"""One trial: the changed file on disk, a forked process that has its libraries loaded, pytest."""

import importlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

# Loaded once, before the first fork. Nothing of rsa_data is.
LIBRARIES = ("numpy", "pandas", "pyarrow.parquet", "pyarrow.compute", "pyarrow.dataset", "cv2",
             "PIL.Image", "torch", "onnxruntime", "safetensors.torch", "msgspec", "click", "tqdm",
             "tokenizers", "hypothesis", "scipy.optimize")  # fmt: skip
# No plugin but the one that pyproject.toml sets: loading all of them takes longer than most tests.
PYTEST = ["-p", "pytest_timeout", "-p", "no:cacheprovider"]
MEMORY = 8 << 30  # bytes of data a trial may take: a changed loop can allocate without end


def copied(root: Path, tree: Path) -> None:
    """Bring `tree` to the tracked and new files of the working tree."""
    command = ["git", "ls-files", "-co", "--exclude-standard"]
    run = subprocess.run(command, cwd=root, check=True, capture_output=True, text=True)
    listed = run.stdout.splitlines()
    for name in listed:
        source, target = root / name, tree / name
        if not source.is_file():
            continue
        if not target.is_file() or source.read_bytes() != target.read_bytes():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)
    for path in tree.rglob("*.py"):
        if path.relative_to(tree).as_posix() not in listed:
            path.unlink()


def load_libraries() -> None:
    for name in LIBRARIES:
        with suppress(ImportError):
            importlib.import_module(name)


def forked(tree: Path, log: Path, limit: float, work: Callable[[], int]) -> int | None:
    """Exit status of `work` in a child that stands in `tree`; None when the time ran out."""
    child = os.fork()
    if child == 0:
        status = 70
        try:
            os.setsid()
            out = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.dup2(out, 1)
            os.dup2(out, 2)
            resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
            os.chdir(tree)
            os.environ["PYTHONPATH"] = str(tree)
            os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
            sys.path[:] = [str(tree), *(p for p in sys.path if "benchmarks" not in p)]
            status = int(work())
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
        finally:
            os._exit(status)
    end = time.monotonic() + limit
    try:
        while time.monotonic() < end:
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                return os.waitstatus_to_exitcode(status)
            time.sleep(0.02)
    finally:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


@contextmanager
def changed(path: Path, code: str):
    """The file with other contents, and a time of its own, so that no compiled file is taken."""
    before, status = path.read_bytes(), path.stat()
    path.write_text(code, "utf-8")
    os.utime(path, ns=(status.st_atime_ns, time.time_ns() + 10_000_000_000))
    try:
        yield
    finally:
        path.write_bytes(before)
        os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


class FirstFailure:
    """A pytest plugin: what failed first."""

    def __init__(self, out: Path):
        self.out = out

    def pytest_runtest_logreport(self, report):
        if report.failed and not self.out.exists():
            self.out.write_text(json.dumps(report.nodeid))

    def pytest_collectreport(self, report):
        if report.failed and not self.out.exists():
            self.out.write_text(json.dumps(f"import of {report.nodeid}"))


def tried(tree: Path, tests: list[tuple[str, float]], scratch: Path) -> dict:
    """Run the tests in the tree as it is: {"outcome": survived | caught | error, "by": what}."""
    first, log, base = scratch / "first.json", scratch / "trial.log", scratch / "base"
    first.unlink(missing_ok=True)
    shutil.rmtree(base, ignore_errors=True)
    names = [name for name, _ in tests]

    def work() -> int:
        sys.dont_write_bytecode = True
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
        return pytest.main(
            ["-x", *PYTEST, f"--basetemp={base}", *names], plugins=[FirstFailure(first)]
        )

    begun = time.monotonic()
    status = forked(tree, log, 20 + 4 * sum(seconds for _, seconds in tests), work)
    spent = round(time.monotonic() - begun, 2)
    shutil.rmtree(base, ignore_errors=True)
    if status == 0:
        return {"outcome": "survived", "by": "", "seconds": spent}
    if status is None:
        return {"outcome": "caught", "by": "time limit", "seconds": spent}
    if first.exists():
        return {"outcome": "caught", "by": json.loads(first.read_text()), "seconds": spent}
    text = log.read_text("utf-8", "replace")
    if status in (2, 4) and ("ImportError" in text or "Traceback" in text):
        return {"outcome": "caught", "by": "import", "seconds": spent}
    if status < 0:
        return {"outcome": "caught", "by": f"signal {-status}", "seconds": spent}
    return {"outcome": "error", "by": f"exit {status}: {text[-300:]}", "seconds": spent}
