"""The log of a run: one file of JSON lines in WORK/logs, for people, `status` and `verify`.

Times, hosts and seconds stand here and nowhere else: parts and receipts must not depend on them.
"""

import contextlib
import json
import logging
import os
import socket
from datetime import UTC, datetime
from typing import Any

from ..common.errors import RsaDataError
from .tables import WorkDir


class RunLog(logging.Handler):
    """Takes down events of a run over one table, and warnings that anything logs meanwhile.

    An event is a line such as
    {"event": "part", "part": 7, "rows": 2000, "seconds": 12.5, "time": "2025-01-31T12:00:00Z"}.
    """

    def __init__(self, work: WorkDir, dataset: str, table: str):
        super().__init__(logging.WARNING)
        now = datetime.now(UTC)
        # Down to the microsecond: two runs of one process must not share a file.
        stamp = now.strftime("%Y%m%dT%H%M%S.%f")
        who = f"{socket.gethostname()}.{os.getpid()}"
        self.store = work.store
        self.path = f"{_prefix(dataset, table)}{stamp}.{who}.jsonl"

    def __enter__(self) -> "RunLog":
        logging.getLogger().addHandler(self)
        return self

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        logging.getLogger().removeHandler(self)
        if error is not None:
            self.write("stopped", error=f"{type(error).__name__}: {error}")
        with contextlib.suppress(RsaDataError):
            self.store.finish(self.path)

    def write(self, event: str, **what: Any) -> None:
        """Adds a line. A log that cannot be written is no reason to stop."""
        moment = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        line = json.dumps({"event": event, **what, "time": moment}, ensure_ascii=False)
        with contextlib.suppress(RsaDataError):
            self.store.append(self.path, line.encode() + b"\n")

    def emit(self, record: logging.LogRecord) -> None:
        self.write(record.levelname.lower(), logger=record.name, message=record.getMessage())


def _prefix(dataset: str, table: str) -> str:
    return f"logs/{dataset}.{table.replace('/', '.')}."


def last_run(work: WorkDir, dataset: str, table: str) -> list[dict[str, Any]]:
    """The events of the newest run over a table; none when there is no log of it."""
    start = _prefix(dataset, table).removeprefix("logs/")
    names = [name for name in work.store.list("logs") if name.startswith(start)]
    # A stamp begins with a digit; the name of another table that begins alike does not.
    names = [name for name in names if name[len(start) : len(start) + 1].isdigit()]
    if not names:
        return []
    try:
        data = work.store.read(f"logs/{max(names)}") or b""
    except RsaDataError:
        return []  # a log is for information: nothing stops because there is none
    events = []
    for line in data.splitlines():
        with contextlib.suppress(ValueError):  # the last line of a run that was killed
            events.append(json.loads(line))
    return [event for event in events if isinstance(event, dict)]


def rate(events: list[dict[str, Any]]) -> float | None:
    """Rows a second over all workers of a run, from its first event to its last part."""
    parts = [event for event in events if event.get("event") == "part"]
    if not parts:
        return None
    try:
        begun, ended = (_seconds(event["time"]) for event in (events[0], parts[-1]))
        longest: float = max(event["seconds"] for event in parts)
        # Times are whole seconds: a short run lasted at least as long as its longest part.
        rows: float = sum(event["rows"] for event in parts)
        return rows / max(ended - begun, longest, 1e-3)
    except (KeyError, TypeError, ValueError, OverflowError):  # a log that somebody changed
        return None


def _seconds(moment: str) -> float:
    return datetime.strptime(moment, "%Y-%m-%dT%H:%M:%SZ").replace(tzinfo=UTC).timestamp()
