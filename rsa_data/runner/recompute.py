"""Whether parts come out the same when they are made again."""

import random
from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa

from ..store import schemas
from ..store.tables import Table, WorkDir
from . import fingerprints, jobs, parts, stages, status

# Model outputs on another CPU type, device or library version: the most that a row's values may be
# off, as a share of the row's norm, by the arithmetic of the model. Measured between CPUs with and
# without AVX-512, AVX2 and FMA (benchmarks/cpu_types.py), float32 differs by up to 8.6e-6, and what
# is kept as float16 by one step of up to 9.8e-4 of a value; bfloat16, computed by its own units or
# in float32, by 1.3e-2; int8, whose products saturate without VNNI, by 5.8e-2 (CLIP's shape).
# float16 runs on GPUs alone and was not measured.
TOLERANCES = {"float32": 2e-3, "float16": 5e-3, "bfloat16": 2.5e-2, "int8": 0.12}

# Columns of float16 as bytes, one array a row: schemas/depth.toml.
_HALVES = ("relative", "metric")

Report = Callable[[str], Any]


def recompute(work: WorkDir, count: int, report: Report, *, seed: int | None = None) -> int:
    """Makes `count` random parts of every stage's tables again and compares; returns problems.

    The logical content must be equal; floats may differ by TOLERANCES, which is reported. Parts
    that are out of date are left out. seed : of the choice; None draws another one each time.
    """
    problems = 0
    for dataset in work.datasets():
        for name in work.tables(dataset):
            table = work.table(dataset, name)
            if stages.known(table.description().stage) is None:
                continue
            current = sorted(set(table.parts()) - status.outdated(work, table))
            chosen = random.Random(seed).sample(current, min(count, len(current)))
            problems += _recompute(work, table, sorted(chosen), report)
    return problems


def _recompute(work: WorkDir, table: Table, numbers: list[int], report: Report) -> int:
    job = jobs.job_of(work, table.dataset, table.name)
    if not fingerprints.same(table.description(), fingerprints.describe(job)):
        report(f"{table}: its options, model files or version are not those of today; left out")
        return 1
    step = parts.build_step(job, table.description()) if numbers else None
    problems = 0
    for number in numbers:
        assert step is not None
        again = step(*(job.table(name).read(number) for name in job.inputs))
        there = table.read(number)
        if schemas.digest(again) == schemas.digest(there):
            report(f"{table} part {number}: the same")
            continue
        tolerance = TOLERANCES[job.options.get("precision", "float32")]
        wrong, most = compare(there, again, tolerance)
        problems += bool(wrong)
        said = "; ".join(wrong) or f"equal within {tolerance:g}: at most {most:.2g} of a row's norm"
        report(f"{table} part {number}: {said}")
    return problems


def compare(there: pa.Table, again: pa.Table, tolerance: float) -> tuple[list[str], float]:
    """(what differs beyond the tolerance, largest difference of floats as a share of the norm)."""
    if there.schema.names != again.schema.names or len(there) != len(again):
        return [f"expected {len(there)} rows, found {len(again)}, or other columns"], 0.0
    wrong, most = [], 0.0
    others: dict[int, list[str]] = {}  # rows that are not the same but for their floats
    pairs = {}
    for name in there.schema.names:
        one, two = there[name].combine_chunks(), again[name].combine_chunks()
        if one.equals(two):
            continue
        before, after = floats(there, name), floats(again, name)
        if before is None or after is None:
            same = [a == b for a, b in zip(one.to_pylist(), two.to_pylist(), strict=True)]
        else:
            same = [a.shape == b.shape for a, b in zip(before, after, strict=True)]
            pairs[name] = before, after
        for row in (row for row, equal in enumerate(same) if not equal):
            others.setdefault(row, []).append(name)
    for name, (before, after) in pairs.items():
        rows = [row for row in range(len(there)) if row not in others]
        off = max((_distance(before[row], after[row]) for row in rows), default=0.0)
        most = max(most, off)
        if not off <= tolerance:
            wrong.append(f"column {name} differs by up to {off:.2g} of a row's norm")
    if others:
        row, names = min(others.items())
        wrong.append(
            f"{len(others)} of {len(there)} rows have another content, the first is row {row} "
            f"({there[there.schema.names[0]][row].as_py()!r:.80}) in {', '.join(names)}"
        )
        if "score" in names:
            wrong.append(
                "on another CPU type or device a segment whose score lies at the threshold can "
                "come or go; where one machine shall decide, delete the receipt and make it there"
            )
    return wrong, most


def floats(table: pa.Table, name: str) -> list[np.ndarray] | None:
    """The floats of a column, one float64 array a row; None for columns of other types."""
    metadata = table.schema.field(name).metadata or {}
    column = table[name].combine_chunks()
    if b"dtype" in metadata and pa.types.is_fixed_size_binary(column.type):
        return list(schemas.embedding_array(table, name).astype(np.float64))
    if name in _HALVES and pa.types.is_binary(column.type):
        return [np.frombuffer(v or b"", "<f2").astype(np.float64) for v in column.to_pylist()]
    kind = column.type
    while pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
        kind = kind.value_type
    if not pa.types.is_floating(kind):
        return None
    return [np.array([] if v is None else v, np.float64).ravel() for v in column.to_pylist()]


def _distance(one: np.ndarray, two: np.ndarray) -> float:
    """Norm of the difference over the norm of a row; inf where only one is nan."""
    if (np.isnan(one) != np.isnan(two)).any():
        return float("inf")
    one, two = np.nan_to_num(one), np.nan_to_num(two)
    return float(np.linalg.norm(one - two)) / max(float(np.linalg.norm(one)), 1e-12)
