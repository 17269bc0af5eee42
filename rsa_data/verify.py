"""Whether a work dir is what its receipts say, and whether its parts come out the same again."""

import hashlib
import random
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from . import identity, stages, status, steps, tables
from .errors import RsaDataError
from .parts import Parts, Work
from .units import size

# Model outputs on another CPU type, device or library version: the most that a row's values may be
# off, as a share of the row's norm. float16 storage alone rounds by up to 4.9e-4 of a value.
TOLERANCE = 5e-3

Say = Callable[[str], Any]


def verify(work: Work, say: Say) -> int:
    """Reads every part of every table again. Says each problem; returns how many there are.

    Checked: bytes and sha256 against the receipt, schema, digest of the content, rows accounted
    for against the input, that no part came from an input that has changed since, and that a
    manifest has the receipts that lie there.
    """
    problems = checked = total = 0
    for dataset in work.datasets():
        for name in work.tables(dataset):
            table = work.table(dataset, name)
            description = table.description()
            old = status.outdated(work, table)
            manifest = table.stored_manifest()
            for number in table.parts():
                receipt = table.receipt(number)
                found = list(_check(work, table, description, receipt))
                if number in old:
                    found.append("its input has changed since: run the stage again")
                if manifest is not None and receipt not in manifest["parts"]:
                    found.append("the manifest has another receipt: run the stage again")
                for text in found:
                    say(f"{table} part {number}: {text}")
                problems += len(found)
                checked += 1
                total += receipt["bytes"]
    say(f"{checked} parts, {size(total)} read: {problems or 'no'} problems")
    return problems


def _check(
    work: Work, table: Parts, description: dict[str, Any], receipt: dict[str, Any]
) -> Iterator[str]:
    number = receipt["part"]
    data = table.store.read(f"{table.path}/{receipt['file']}")
    if data is None:
        yield f"expected {receipt['file']}, found no such file"
        return
    if (found := hashlib.sha256(data).hexdigest()) != receipt["sha256"]:
        yield f"expected sha256 {receipt['sha256'][:12]}..., found {found[:12]}..."
        return
    try:
        rows = pq.read_table(pa.BufferReader(data), use_threads=False)
        tables.check(description["schema"], rows)
    except (RsaDataError, pa.ArrowException, OSError) as error:
        yield str(error)
        return
    if len(rows) != receipt["rows"]:
        yield f"expected {receipt['rows']} rows, found {len(rows)}"
    if tables.digest(rows) != receipt["digest"]:
        yield "the content has another digest than the receipt says"
    stage = stages.STAGES.get(description["stage"])
    for name in description["inputs"][:1]:
        source = work.table(table.dataset, name)
        if number not in source.parts():
            yield f"its input {name} is not there any more"
        elif stage is not None:
            try:
                counts = steps.account(source.read(number), rows, stage.unit, str(table))
            except RsaDataError as error:
                yield str(error)
                continue
            if counts != {key: receipt[key] for key in counts}:
                yield f"expected {counts}, as its rows say; the receipt says otherwise"


def recompute(work: Work, count: int, say: Say, *, seed: int | None = None) -> int:
    """Makes `count` random parts of every stage's tables again and compares; returns problems.

    The logical content must be equal; float columns may differ by TOLERANCE, which is said. Parts
    that are out of date are left out. seed : of the choice; None draws another one each time.
    """
    problems = 0
    for dataset in work.datasets():
        for name in work.tables(dataset):
            table = work.table(dataset, name)
            if table.description()["stage"] not in stages.STAGES:
                continue
            current = sorted(set(table.parts()) - status.outdated(work, table))
            chosen = random.Random(seed).sample(current, min(count, len(current)))
            problems += _recompute(work, table, sorted(chosen), say)
    return problems


def _recompute(work: Work, table: Parts, numbers: list[int], say: Say) -> int:
    job = stages.job_of(work, table.dataset, table.name)
    if not identity.same(table.description(), identity.describe(job)):
        say(f"{table}: its options, model files or version are not those of today; left out")
        return 1
    step = steps.build_step(job) if numbers else None
    problems = 0
    for number in numbers:
        assert step is not None
        again = step(*(job.table(name).read(number) for name in job.inputs))
        there = table.read(number)
        if tables.digest(again) == tables.digest(there):
            say(f"{table} part {number}: the same")
            continue
        wrong, most = compare(there, again)
        problems += bool(wrong)
        said = "; ".join(wrong) or f"equal within {TOLERANCE:g}: at most {most:.2g} of a row's norm"
        say(f"{table} part {number}: {said}")
    return problems


def compare(there: pa.Table, again: pa.Table) -> tuple[list[str], float]:
    """(what differs beyond the tolerance, largest difference of floats as a share of the norm)."""
    if there.schema.names != again.schema.names or len(there) != len(again):
        return [f"expected {len(there)} rows, found {len(again)}, or other columns"], 0.0
    wrong, most = [], 0.0
    for name in there.schema.names:
        one, two = there[name].combine_chunks(), again[name].combine_chunks()
        if one.equals(two):
            continue
        floats = _floats(there, name), _floats(again, name)
        if floats[0] is None or floats[1] is None or floats[0].shape != floats[1].shape:
            wrong.append(f"column {name} differs")
            continue
        off = _distance(floats[0], floats[1])
        most = max(most, off)
        if not off <= TOLERANCE:
            wrong.append(f"column {name} differs by up to {off:.2g} of a row's norm")
    return wrong, most


def _floats(table: pa.Table, name: str) -> np.ndarray | None:
    """The floats of a column, (rows, values) where every row has as many; None for other types."""
    metadata = table.schema.field(name).metadata or {}
    column = table[name].combine_chunks()
    if b"dtype" in metadata and pa.types.is_fixed_size_binary(column.type):
        return tables.embedding_array(table, name).astype(np.float64)
    rows = len(column)
    while pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type):
        column = column.flatten()
    if not pa.types.is_floating(column.type):
        return None
    values = column.to_numpy(zero_copy_only=False).astype(np.float64)
    return values.reshape(rows, -1) if rows and len(values) % rows == 0 else values[None]


def _distance(one: np.ndarray, two: np.ndarray) -> float:
    """Largest norm of a row's difference over the row's norm; inf where only one is nan."""
    if (np.isnan(one) != np.isnan(two)).any():
        return float("inf")
    one, two = np.nan_to_num(one), np.nan_to_num(two)
    norms = np.maximum(np.linalg.norm(one, axis=1), 1e-12)
    return float((np.linalg.norm(one - two, axis=1) / norms).max(initial=0.0))
