"""`python -m rsa_data` and the console script: signals are handled before anything is imported."""

import os
import signal
from typing import Any


def main() -> None:
    """Runs the command line; see cli/main.py."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)
    # Threads of OpenMP that wait for work spin unless they are told to sleep: where other programs
    # want the cores too, that took six times the CPU time of the work. Read when torch loads.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    from rsa_data.cli.main import main as run

    run()


def _stop(number: int, frame: Any) -> None:
    os.write(2, b"\nStopped.\n")
    os._exit(130)


if __name__ == "__main__":
    main()
