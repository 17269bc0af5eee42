"""What a person at a terminal sees of a run: progress, and a summary that ends with what to do."""

import sys
import time
from typing import TYPE_CHECKING

from ..common.units import duration as duration
from ..common.units import size as size

if TYPE_CHECKING:
    from ..runner.runs import Bar, Summary


class Lines:
    """Progress for logs and pipes: a line now and then, with rate and time left."""

    def __init__(self, title: str, total: int, every: float = 10.0):
        self.title, self.total, self.every = title, total, every
        self.done, self.begun = 0, time.monotonic()
        self.last = self.begun

    def update(self, rows: int) -> None:
        """Counts rows; writes a line when the last one is long enough ago."""
        self.done += rows
        now = time.monotonic()
        if now - self.last >= self.every:
            self.last = now
            rate = self.done / (now - self.begun)
            left = (self.total - self.done) / rate if rate else 0
            print_error(
                f"{self.title}: {self.done:,} of {self.total:,}, {rate:,.1f}/s, "
                f"{duration(left)} left"
            )

    def close(self) -> None:
        """Nothing to tidy up."""


def print_error(text: str) -> None:
    """One line to standard error."""
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def warn(text: str) -> None:
    """One line to standard error that begins with `warning:`."""
    print_error(f"warning: {text}")


def bar(title: str, total: int) -> "Bar":
    """A progress bar with rate and time left on a terminal, plain lines elsewhere."""
    if sys.stderr.isatty():
        from tqdm import tqdm

        shown: Bar = tqdm(total=total, desc=title, unit=" rows", smoothing=0.1, leave=False)
        return shown
    return Lines(title, total)


def summary_lines(stage: str, dataset: str, summary: "Summary") -> list[str]:
    """The summary of a stage over one dataset, in plain sentences."""
    unit = summary.noun
    accounted = f"{summary.ok:,} {unit} ok"
    accounted += f", {summary.failed:,} failed" if summary.failed else ""
    accounted += f", {summary.skipped:,} skipped" if summary.skipped else ""
    lines = [f"{stage} {dataset}: {accounted}; {summary.rows:,} rows, {size(summary.bytes)}"]
    if summary.done:
        rate = summary.worked / summary.seconds if summary.seconds else 0
        lines.append(
            f"  {_parts(summary.done)} in {duration(summary.seconds)} ({rate:,.0f} {unit}/s)"
            + (f", {_parts(summary.kept)} kept from before" if summary.kept else "")
        )
    elif summary.kept:
        lines.append(f"  nothing to do: {_parts(summary.kept)} there already")
    else:
        lines.append("  nothing to do: the dataset has no part in this range")
    if summary.stale:
        lines.append(f"  {_parts(summary.stale)} made again because their input had changed")
    if summary.gone:
        lines.append(f"  {_parts(summary.gone)} made again because their data was gone")
    for reason, count in summary.reasons:
        lines.append(f"  failed {_times(count)}, such as: {reason}")
    for reason, count in summary.skips:
        lines.append(f"  skipped {_times(count)}, such as: {reason}")
    if summary.left:
        lines.append(f"  not chosen by this run and still to be made: {_parts(summary.left)}")
    if summary.failed:
        lines.append("  mend the input, then: rsa-data retry-failed")
    lines += [f"  {note}" for note in summary.notes]
    lines.append(f"  in {summary.output}")
    return lines


def _times(count: int) -> str:
    return f"{count:,} time" + ("" if count == 1 else "s")


def _parts(count: int) -> str:
    return f"{count:,} part" + ("" if count == 1 else "s")
