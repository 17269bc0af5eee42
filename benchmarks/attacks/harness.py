"""One attack: what it prepares, which command it runs, what may come of it, what came of it."""

import contextlib
import os
import re
import resource
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

MOST_MEMORY = 1.5e9  # bytes that one hostile input may take, of this process and its workers
DEADLINE = 60.0  # seconds
KEY = "sk-hostile-7f3a9c0d5e"  # a secret that must appear nowhere

# What a terminal would obey: C0 and C1 but tab, line feed and return, and marks of direction.
_CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
# Words of the harness's own mistakes: such a refusal shows nothing.
_MISTAKE = re.compile("No such option|no such option|unknown command|Missing option|Got unexpected")


@dataclass(frozen=True)
class Attack:
    """words : the command line after rsa-data. prepare : makes the input below its folder.

    may : outcomes that are right: refused (status 1 or 2 and an error line), failed (rows), or
        accepted. says : a pattern of what must be said then.
    check : what else is wrong with the folder and the text that was printed, or None.
    after : (seconds, signal) to send; the process is then a real one, started from nothing, and
        must end within 5 seconds of it.
    """

    name: str
    words: tuple[str, ...]
    prepare: Callable[[Path], object] | None = None
    may: frozenset[str] = frozenset({"refused"})
    says: str | None = None
    check: Callable[[Path, str], str | None] | None = None
    deadline: float = DEADLINE
    environment: dict[str, str] = field(default_factory=dict)
    after: tuple[float, int] | None = None
    mistakes: bool = False  # whether a wrong call is the attack itself
    stdout: str | None = None  # a file or device that standard output goes to


@dataclass
class Result:
    """outcome : refused, failed, accepted, traceback, hang or broken (the attack itself)."""

    attack: Attack
    outcome: str
    text: str
    seconds: float
    peak: float
    wrong: str | None = None


REFUSED, FAILED, ACCEPTED = (frozenset({kind}) for kind in ("refused", "failed", "accepted"))
CONTAINED = REFUSED | FAILED
ANY = CONTAINED | ACCEPTED


_STOPPING = (signal.SIGINT, signal.SIGTERM)


class Running:
    """An attack in a process of its own, which was forked with everything imported."""

    def __init__(self, attack: Attack, folder: Path):
        self.attack, self.folder = attack, folder
        self.box = folder / "box"
        self.box.mkdir(parents=True)
        (folder / "tmp").mkdir()
        self.begun, self.sent = 0.0, 0.0
        self.pid = os.fork()
        if not self.pid:
            self._prepare()
        _, status, _ = os.wait4(self.pid, 0)
        self.broken = status != 0
        self.before = _listing(self.box)
        # A signal at once must not reach the fork itself, but the command.
        signal.pthread_sigmask(signal.SIG_BLOCK, _STOPPING)
        self.pid = os.fork()
        if not self.pid:
            self._child()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOPPING)
        self.begun = time.monotonic()

    def _prepare(self) -> None:
        status = 1
        try:
            self._enter()
            if self.attack.prepare:
                self.attack.prepare(self.box)
            status = 0
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(status)

    def _enter(self, stdout: str | None = None) -> None:
        os.setsid()
        os.chdir(self.box)
        os.environ.update(
            {
                "HOME": str(self.folder),
                "XDG_CACHE_HOME": str(self.folder / "cache"),
                "TMPDIR": str(self.folder / "tmp"),
                "HF_HUB_OFFLINE": "1",
                "COLUMNS": "100",
                **self.attack.environment,
            }
        )
        null = os.open(os.devnull, os.O_RDONLY)
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
        said = os.open(self.folder / "said", flags)
        os.dup2(null, 0)
        os.dup2(said if stdout is None else os.open(stdout, os.O_WRONLY), 1)
        os.dup2(said, 2)
        # A file that nobody could hold: sparse ones stay small on disk.
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    def _child(self) -> None:
        try:
            self._enter(self.attack.stdout)
            # A shell that runs this in the background has it ignored.
            own = signal.SIG_DFL if self.attack.after else signal.default_int_handler
            signal.signal(signal.SIGINT, own)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOPPING)
            sys.argv = ["rsa-data", *self.attack.words]
            if self.attack.after:
                os.execv(sys.executable, [sys.executable, "-m", "rsa_data", *self.attack.words])
            from rsa_data.cli.main import main

            main()
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else 0 if ended.code is None else 1
            _leave(code)
        except BaseException:
            traceback.print_exc()
            _leave(1)
        finally:
            _leave(0)

    def poll(self) -> Result | None:
        """What came of it, once it has ended or its time is over."""
        now = time.monotonic()
        after = self.attack.after
        if after and not self.sent and now - self.begun >= after[0]:
            os.kill(self.pid, after[1])
            self.sent = now
        over = now - self.sent > 5 if self.sent else now - self.begun > self.attack.deadline
        if over:
            self._kill()
            _, _, usage = os.wait4(self.pid, 0)
            return self._result("hang", usage, now)
        if _holds(self.pid) > 2 * MOST_MEMORY:  # before it takes what others need
            self._kill()
        pid, status, usage = os.wait4(self.pid, os.WNOHANG)
        if not pid:
            return None
        self._kill()  # what it started and left
        return self._result(self._outcome(os.waitstatus_to_exitcode(status)), usage, now)

    def _kill(self) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, signal.SIGKILL)

    def _said(self) -> str:
        path = self.folder / "said"
        return path.read_bytes()[-200_000:].decode("utf-8", "backslashreplace")

    def _outcome(self, status: int) -> str:
        said = self._said()
        if self.broken:
            return "broken"
        # Python itself reports a SIGINT that comes before the first line of this package has run.
        early = self.sent and "rsa_data" not in said and said.endswith("KeyboardInterrupt\n")
        if ("Traceback (most recent" in said or "nexpected error" in said) and not early:
            return "traceback"
        if self.sent:
            # SIGINT and SIGTERM of a process that has not come to its own code yet are death.
            return (
                "refused"
                if status in (130, -signal.SIGINT, -signal.SIGTERM, 0, 1, 2)
                else "traceback"
            )
        if status not in (0, 1, 2, 130):
            return "traceback"
        if not self.attack.mistakes and _MISTAKE.search(said):
            return "broken"
        if re.search(r"[1-9][\d,]* (failed|images have no text and got)", said):
            return "failed"
        if status == 0:
            return "accepted"
        return "refused" if re.search(r"^(\S+: )?Error: |^Stopped", said, re.M) else "traceback"

    def _result(self, outcome: str, usage: resource.struct_rusage, now: float) -> Result:
        said, attack = self._said(), self.attack
        result = Result(attack, outcome, said, now - self.begun, usage.ru_maxrss * 1024)
        if result.peak > MOST_MEMORY:
            result.wrong = f"took {result.peak / 1e9:.1f} GB"
            return result
        if outcome in ("traceback", "hang", "broken"):
            return result
        if outcome not in attack.may:
            result.wrong = f"{outcome}, expected {' or '.join(sorted(attack.may))}"
        elif attack.says and not re.search(attack.says, said):
            result.wrong = f"{outcome}, but says nothing like {attack.says!r}"
        elif control := _CONTROL.search(said):
            result.wrong = f"prints the control character {control[0]!r}"
        elif where := self._leak():
            result.wrong = f"the key stands in {where}"
        elif attack.check:
            result.wrong = attack.check(self.box, said)
        return result

    def _leak(self) -> str | None:
        if KEY not in str(self.attack.environment):
            return None
        for path in self.folder.rglob("*"):
            if (
                path.is_file()
                and path.stat().st_size < 1 << 24
                and KEY.encode() in path.read_bytes()
            ):
                return str(path.relative_to(self.folder))
        return None


def _holds(pid: int) -> int:
    """Bytes that a process has in memory."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError, ValueError):
        return 0


def _listing(box: Path) -> set[str]:
    return {str(path.relative_to(box)) for path in box.iterdir()}


def _leave(code: int) -> None:
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError):
        code = code or 1
    os._exit(code)


def run(attacks: Iterable[Attack], jobs: int, place: Path) -> Iterator[Result]:
    """Runs attacks, so many at once, each in a folder of its own below `place`."""
    waiting, running, number = iter(attacks), list[Running](), 0
    more = True
    while more or running:
        while more and len(running) < jobs:
            attack = next(waiting, None)
            if attack is None:
                more = False
                break
            number += 1
            running.append(Running(attack, place / f"{number:04d}"))
        for one in list(running):
            if (result := one.poll()) is not None:
                running.remove(one)
                yield result
                shutil.rmtree(one.folder, ignore_errors=True)
        time.sleep(0.01)
