"""Moments between the writes of a commit, at which a test can kill the process."""

import os
import signal

_hits: dict[str, int] = {}


def failpoint(moment: str) -> None:
    """Kills this process when RSA_DATA_FAILPOINT names this moment (`rename`, or `rename:3`).

    With a number the third time counts, so that a test can reach a later part; `any:3` is the
    third moment of whatever name, and `any:0` never comes. Nothing else happens here.
    """
    wanted, _, nth = os.environ.get("RSA_DATA_FAILPOINT", "").partition(":")
    if wanted in (moment, "any"):
        _hits[wanted] = _hits.get(wanted, 0) + 1
        if _hits[wanted] == int(nth or 1):
            os.kill(os.getpid(), signal.SIGKILL)


def passed(wanted: str) -> int:
    """How often this process has passed the moment that RSA_DATA_FAILPOINT names."""
    return _hits.get(wanted, 0)
