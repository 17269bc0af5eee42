"""What a run reports to its caller: progress, and at the end a summary."""

from dataclasses import dataclass
from typing import Any, Protocol


class Bar(Protocol):
    """What shows progress: tqdm, or plain lines."""

    def update(self, rows: int) -> Any:
        """Adds rows that are done."""

    def close(self) -> None:
        """Removes the bar."""


@dataclass(frozen=True)
class Summary:
    """What a run did and what the table holds now.

    done : parts made in this run; kept : parts that were there; stale : of the parts made, those
        made again because their input had changed; gone : because their data was gone; undone :
        parts left for a later run, with why.
    rows, ok, failed, skipped, bytes : of the selected parts. seconds : of this run.
    reasons, skips : why rows failed and were skipped, with how often.
    left : parts of the table that a run of other parts has still to make.
    worked : samples or texts that this run accounted for, for the rate.
    notes : what the stage has to say of its output, in sentences.
    noun : what is counted, such as samples.
    """

    output: str
    done: int
    kept: int
    stale: int
    gone: int
    undone: dict[int, str]
    rows: int
    ok: int
    failed: int
    skipped: int
    bytes: int
    seconds: float
    worked: int
    reasons: list[tuple[str, int]]
    skips: list[tuple[str, int]]
    left: int
    notes: list[str]
    noun: str = "samples"

    @staticmethod
    def nothing(output: str) -> "Summary":
        """The summary where nothing was run."""
        return Summary(output, 0, 0, 0, 0, {}, 0, 0, 0, 0, 0, 0.0, 0, [], [], 0, [])
