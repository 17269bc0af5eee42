"""Running a stage on one part: load the step, read, compute, account for every row, commit."""

import json
from collections.abc import Callable
from functools import partial
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from ..common import options
from ..common.errors import RsaDataError, TransientError
from ..datasets import index
from ..datasets.roots import open_root
from ..store.tables import Description, Made, Receipt, WorkDir
from .cpu import cpu_type
from .fingerprints import check_read, part_fingerprint, part_inputs, same
from .jobs import Job
from .stage import Step


def build_step(job: Job, description: Description) -> Step:
    """Loads what the stage needs; called once a worker.

    Raises RsaDataError where model files or code are not those of the description (any more).
    """
    build = job.declared.build
    step: Step = options.call(build, **_given(job, build), **job.options)
    check_read(job, description)  # afterwards: what was replaced before is seen, too
    return step


def _given(job: Job, function: Callable[..., Any]) -> dict[str, Any]:
    """Those of `stage.GIVEN` that a function takes by name."""
    known = options.parameters(function)
    given: dict[str, Any] = {}
    if "dataset" in known:
        given["dataset"] = index.load_dataset(WorkDir(job.work), job.dataset)
    if "root" in known:
        given["root"] = open_root(job.root) if job.root else None
    if "images" in known:
        given["images"] = partial(_images, job)
    if "catalogue" in known:
        given["catalogue"] = partial(_catalogue, job)
    return given


def _images(job: Job) -> list[str]:
    """Paths of all images of the dataset, of every part and split, each once."""
    return list(dict.fromkeys(image for _, image in _catalogue(job) if image is not None))


def _catalogue(job: Job) -> list[tuple[str, str | None]]:
    """sample_id and image of every sample of the dataset, of all parts and splits."""
    samples = job.table("samples")
    found: list[tuple[str, str | None]] = []
    for number in samples.parts():
        part = samples.read(number, columns=["sample_id", "image"])
        found += zip(part["sample_id"].to_pylist(), part["image"].to_pylist(), strict=True)
    return found


def run_part(
    job: Job, step: Step, description: Description, number: int, *, redo: bool = False
) -> Receipt:
    """Reads the input parts, runs the step, accounts for every row, commits; gives the receipt.

    redo : replace the part although it is there, made from the same input.

    Raises TransientError when another run has changed an input part meanwhile.
    """
    stage, output = job.declared, job.table(job.output)
    receipts = {name: job.table(name).receipt(number) for name in job.inputs}
    inputs = [
        job.table(name).read(number, receipt=receipt, check=True)
        for name, receipt in receipts.items()
    ]
    inputs[0] = _numbered(inputs[0], number)
    made = step(*inputs)
    counts = account(inputs[0], made, stage.unit, f"{job.dataset}/{job.output} part {number}")
    digests = {name: receipt.digest for name, receipt in receipts.items()}
    if part_inputs(job, number) != digests or not same(output.description(), description):
        raise TransientError(
            f"{output}: another run changed the input or the options of part {number} meanwhile. "
            "Let it end, then run the same command again"
        )
    return output.commit(
        number,
        made,
        Made(
            **counts,
            audit=_measured(made),
            cpu=cpu_type() if stage.models and description.files else "",
            split=job.table("samples").receipt(number).split,
            inputs=digests,
            fingerprint=part_fingerprint(description, digests),
        ),
        redo=redo,
    )


def _numbered(table: pa.Table, number: int) -> pa.Table:
    """The table with the number of its part in its metadata, for steps that sample a table."""
    metadata = {**(table.schema.metadata or {}), b"part": str(number).encode()}
    return table.replace_schema_metadata(metadata)


def _measured(made: pa.Table) -> dict[str, Any] | None:
    """What a step measured of its own work: JSON under `audit` in its table's metadata."""
    audit = (made.schema.metadata or {}).get(b"audit")
    return json.loads(audit) if audit else None


def account(before: pa.Table, after: pa.Table, unit: str, where: str) -> dict[str, int]:
    """ok, failed and skipped units of a part; they are all that came in, or RsaDataError.

    A unit of `before` that did not end well there is skipped when `after` has no row for it.
    """
    came, went = pc.unique(before[unit]), pc.unique(after[unit])
    if "status" in after.column_names:
        status = after["status"]
        failed = pc.sum(pc.equal(status, "failed"), min_count=0).as_py()
        skipped = pc.sum(pc.equal(status, "skipped"), min_count=0).as_py()
        ok = len(after) - failed - skipped
    else:
        ok, failed, skipped = len(went), 0, 0
    if "status" in before.column_names:
        gone = before.filter(pc.not_equal(before["status"], "ok"))[unit]
        skipped += pc.sum(pc.invert(pc.is_in(gone, went)), min_count=0).as_py()
    strangers = pc.sum(pc.invert(pc.is_in(went, came)), min_count=0).as_py()
    if ok + failed + skipped != len(came) or strangers:
        raise RsaDataError(
            f"{where}: {len(came)} rows came in, but {ok} ok + {failed} failed + {skipped} skipped "
            f"came out, {strangers} of them unknown: rows were lost or made up. Nothing was written"
        )
    return {"ok": ok, "failed": failed, "skipped": skipped}


# Parts that notes look at, evenly over the table: enough for shares, cheap for any number.
_NOTED = 20


def notes(job: Job, numbers: list[int]) -> list[str]:
    """What the stage has to say of the parts `numbers`: sentences for the summary."""
    noted = job.declared.notes
    if not numbers or noted is None:
        return []
    step = -(-len(numbers) // _NOTED)
    made = (job.table(job.output).read(n, columns=list(noted.columns)) for n in numbers[::step])
    inputs = [job.table(name).read(numbers[len(numbers) // 2]) for name in job.inputs]
    return noted.write(made, *inputs, **_given(job, noted.write), **job.options)
