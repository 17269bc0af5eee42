"""Ctrl-C and SIGTERM end any command within seconds, whatever its threads and libraries wait for.

Python handles a signal in the main thread, between two steps of its own: a graph that loops or a
thread that waits for a server would hold it back. So a second thread gives the command a few
seconds to end by itself, and then ends the process. What was committed stays; what was half written
goes with the next sweep, as after a kill.
"""

import contextlib
import os
import signal
import threading
import time
from typing import Any

# s, from the signal to the end of the process.
WITHIN = 3.0

STOPPED = "\nStopped. Finished parts are kept: run the same command to continue."

_STOPPING = (signal.SIGINT, signal.SIGTERM)

_received = threading.Event()
_said = threading.Event()


def install() -> None:
    """Handles SIGINT and SIGTERM in this process from now on, as KeyboardInterrupt.

    A SIGINT that is ignored (`nohup`, `command &` of a shell) stays ignored.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    for number in _STOPPING:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)
    # Written by the C handler at once, even while the main thread is inside a library.
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reader,), name="signals", daemon=True).start()


def received() -> bool:
    """Whether this process was asked to stop: errors that follow are a consequence of that."""
    return _received.is_set()


def say_stopped() -> None:
    """Says once on standard error that the command was stopped."""
    if not _said.is_set():
        _said.set()
        with contextlib.suppress(OSError):  # nobody reads it any more
            os.write(2, STOPPED.encode() + b"\n")


def _interrupt(number: int, frame: Any) -> None:
    _received.set()
    raise KeyboardInterrupt


def _watch(reader: int) -> None:
    while not any(number in _STOPPING for number in os.read(reader, 16)):
        pass
    _received.set()
    time.sleep(WITHIN)
    say_stopped()
    os._exit(130)
