"""What a run would take: parts, hours and bytes, from a few rows of the first part to do."""

import time
from dataclasses import dataclass

import pyarrow as pa
import pyarrow.compute as pc

from ..common.units import duration, size
from ..store.encoding import encoded
from ..store.tables import WorkDir
from . import fingerprints, selection
from . import parts as steps
from .jobs import Job

# Rows of the calibration: after a first, untimed call with a few, as many as this.
_WARM, _ROWS = 2, 48


@dataclass(frozen=True)
class Estimate:
    """What is there and what is left of a table.

    parts, rows : of the selection that are left to do; parts_done : that are there. loading : s, of
    each worker. seconds : of one worker for the rows that are left. bytes : of what is left to
    write. free : bytes where the work dir lies, None when unknown. calibrated : rows tried.
    """

    output: str
    parts: int
    parts_done: int
    rows: int
    loading: float
    seconds: float
    bytes: int
    free: int | None
    calibrated: int


def plan(
    job: Job, *, split: str | None = None, part_range: tuple[int, int] | None = None
) -> Estimate:
    """Tries the stage on a few rows, writes nothing, and goes on from there.

    Raises RsaDataError as a run would: for missing inputs, models, or options that do not fit.
    """
    work, output = WorkDir(job.work), job.table(job.output)
    numbers = selection.select(work, job.dataset, split, part_range)
    selection.need_inputs(job, numbers)
    description = fingerprints.describe(job)
    todo = numbers
    if output.exists():
        if not fingerprints.same(output.description(), description):
            output.bind(description)  # says what differs
        todo = fingerprints.pending(job, description, numbers).todo
    samples = work.table(job.dataset, "samples")
    rows = sum(samples.receipt(n).rows for n in todo)
    free = output.store.free()
    done = len(numbers) - len(todo)
    if not rows:
        return Estimate(str(output), len(todo), done, 0, 0.0, 0.0, 0, free, 0)
    begun = time.monotonic()
    step = steps.build_step(job, description)
    step(*_first(job, todo[0], _WARM))
    loading = time.monotonic() - begun
    inputs = _first(job, todo[0], _ROWS)
    tried = len(pc.unique(inputs[0]["sample_id"]))
    begun = time.monotonic()
    made = step(*inputs)
    each = (time.monotonic() - begun) / tried
    count = round(len(encoded(made)) / tried * rows)
    return Estimate(str(output), len(todo), done, rows, loading, each * rows, count, free, tried)


def _first(job: Job, number: int, rows: int) -> list[pa.Table]:
    """The input parts, cut to their first samples."""
    inputs = [job.table(name).read(number) for name in job.inputs]
    chosen = pc.unique(inputs[0]["sample_id"]).slice(0, rows)
    return [t.filter(pc.is_in(t["sample_id"], value_set=chosen)) for t in inputs]


def lines(stage: str, dataset: str, estimate: Estimate, workers: int) -> list[str]:
    """An estimate in plain sentences."""
    e = estimate
    said = [f"{stage} {dataset}: {e.parts:,} parts to do, {e.parts_done:,} done"]
    if e.rows:
        parallel = min(workers, e.parts)
        hours = e.loading + e.seconds / parallel
        said[0] += f"; {e.rows:,} samples"
        said.append(
            f"  about {duration(hours)} with {parallel} worker{'s' * (parallel > 1)}, of which "
            f"{duration(e.loading)} to load; tried on {e.calibrated} samples"
        )
        room = "" if e.free is None else f", {size(e.free)} free"
        said.append(f"  about {size(e.bytes)} to write{room}")
    return [*said, f"  in {e.output}"]
