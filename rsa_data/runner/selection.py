"""The parts that a run is about: which ones, whether their inputs are there, how they ended."""

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import PurePosixPath

import pyarrow.compute as pc

from ..common.errors import RsaDataError, UsageError
from ..store import schemas
from ..store.tables import Receipt, Table, WorkDir
from .jobs import Job


def select(
    work: WorkDir, dataset: str, split: str | None, part_range: tuple[int, int] | None
) -> list[int]:
    """Part numbers of a dataset, of one split and range if asked for."""
    samples = work.table(dataset, "samples")
    numbers = samples.parts()
    if split is not None:
        splits = {receipt.part: receipt.split for receipt in samples.receipts(numbers)}
        if split not in splits.values():
            raise UsageError(
                f"{dataset}: no split {split!r}; there are: {', '.join(sorted({*splits.values()}))}"
            )
        numbers = [n for n in numbers if splits[n] == split]
    if part_range is not None:
        numbers = [n for n in numbers if part_range[0] <= n < part_range[1]]
    return numbers


def need_inputs(job: Job, numbers: list[int]) -> None:
    """Raises RsaDataError unless the index is finished and every input has these parts."""
    if not job.table("samples").complete():
        raise RsaDataError(
            f"{job.table('samples')}: its index was stopped half-way. Finish it first: run the "
            f"first stage of this dataset again, such as rsa-data captions --dataset {job.dataset}"
        )
    for name in job.inputs:
        if missing := sorted(set(numbers) - set(job.table(name).parts())):
            first = ", ".join(map(str, missing[:5])) + (" ..." if len(missing) > 5 else "")
            raise RsaDataError(
                f"{job.table(name)}: expected parts of this table first; {len(missing)} are not "
                f"done: {first}. Run `rsa-data status{WorkDir(job.work).option}` to see what to run"
            )


def accounted(job: Job, numbers: list[int]) -> Iterator[Receipt]:
    """The receipts of parts. Raises RsaDataError when rows of one are not accounted for.

    Stages that count samples must have as many, ok + failed + skipped, as the index.
    """
    counts_samples = job.declared.unit == "sample_id"
    samples = job.table("samples" if counts_samples else job.output).receipts(numbers)
    for receipt, sample in zip(job.table(job.output).receipts(numbers), samples, strict=True):
        if counts_samples and receipt.units != sample.rows:
            raise RsaDataError(
                f"{job.table(job.output)}: part {receipt.part}: expected {sample.rows} "
                f"samples accounted for, found {receipt.units}. Delete its receipt to make it "
                "again"
            )
        yield receipt


def reasons(
    job: Job, numbers: list[int], status: str = "failed", most: int = 3
) -> list[tuple[str, int]]:
    """The most frequent reasons of failed or skipped rows, with how often each occurs.

    Reasons that differ by file name and numbers only count as one, told by its first row. Rows that
    were skipped since an earlier stage has none of them have no reason here.
    """
    first: dict[str, str] = {}
    counts: Counter[str] = Counter()
    table = job.table(job.output)
    for number in numbers:
        if not getattr(table.receipt(number), status):
            continue
        if status == "skipped" and not _tells_rows(table):
            return []
        part = table.read(number, columns=["sample_id", "status", "error"])
        for row in part.filter(pc.equal(part["status"], status)).to_pylist():
            if row["error"] is None:
                continue
            name = PurePosixPath(row["sample_id"]).name
            kind = re.sub(r"\d+", "0", re.sub(r"\S*" + re.escape(name) + r"\S*", "", row["error"]))
            first.setdefault(kind, row["error"])
            counts[kind] += 1
    order = sorted(counts, key=lambda kind: (-counts[kind], first[kind]))
    return [(first[kind], counts[kind]) for kind in order[:most]]


def _tells_rows(table: Table) -> bool:
    """Whether rows have a status; what is skipped in other tables has no row there."""
    return "error" in schemas.schema(table.description().schema).names
