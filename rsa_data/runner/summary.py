"""What a run tells the one who called it: how far it is, and in the end what it did."""

from dataclasses import dataclass
from typing import Any, Protocol


class Bar(Protocol):
    """What shows progress: tqdm, or plain lines."""

    def update(self, rows: int) -> Any:
        """Says that this many more rows are done."""

    def close(self) -> None:
        """No more is to come."""


@dataclass(frozen=True)
class Summary:
    """What a run did and what the table holds now.

    done : parts made in this run; kept : parts that were there; stale : of the parts made, those
        made again because their input had changed; undone : parts left for a later run, with why.
    rows, ok, failed, skipped, bytes : of the selected parts. seconds : of this run.
    worked : samples or texts that this run accounted for, for the rate.
    notes : what the stage has to say of its output, in sentences.
    """

    output: str
    done: int
    kept: int
    stale: int
    undone: dict[int, str]
    rows: int
    ok: int
    failed: int
    skipped: int
    bytes: int
    seconds: float
    worked: int
    reasons: list[tuple[str, int]]
    notes: list[str]

    @staticmethod
    def nothing(output: str) -> "Summary":
        """Of a run that did not take place."""
        return Summary(output, 0, 0, 0, {}, 0, 0, 0, 0, 0, 0.0, 0, [], [])
