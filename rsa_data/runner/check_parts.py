"""Whether one part is what its receipt says, and follows from the table's description."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from ..common.errors import RsaDataError
from ..datasets.index import sample_fingerprint
from ..store import schemas
from ..store.tables import Receipt, Table, WorkDir
from . import parts, stages
from .fingerprints import part_fingerprint


@dataclass
class Checked:
    """What has been read so far; others : heads and results. notes : what is no problem."""

    parts: int = 0
    bytes: int = 0
    others: int = 0
    notes: list[str] = field(default_factory=list)


def check_part(
    work: WorkDir, table: Table, number: int, receipt: Receipt, checked: Checked
) -> tuple[list[str], bool]:
    """(problems of a part, whether its fingerprint is the one that it should have)."""
    checked.parts += 1
    checked.bytes += receipt.bytes
    description = table.description()
    found = [*_numbers(work, table, number, receipt), *_content(work, table, receipt)]
    if description.stage == "index":
        expected = sample_fingerprint(table.dataset, receipt.digest)
    else:
        expected = part_fingerprint(description, receipt.inputs)
    return found, receipt.fingerprint == expected


def _numbers(work: WorkDir, table: Table, number: int, receipt: Receipt) -> Iterator[str]:
    """Part number, split and inputs, as its neighbours have them."""
    if receipt.part != number:
        yield f"its receipt is that of part {receipt.part}"
    inputs = table.description().inputs
    if set(receipt.inputs) != set(inputs):
        yield f"expected the inputs {', '.join(inputs) or 'none'}, found {sorted(receipt.inputs)}"
    samples = work.table(table.dataset, "samples")
    if table.name != samples.name and number in samples.parts():
        try:
            split = samples.receipt(number).split
        except RsaDataError:
            return  # said where the samples are checked
        if split != receipt.split:
            yield f"expected the split {split!r} of its samples, found {receipt.split!r}"


def _content(work: WorkDir, table: Table, receipt: Receipt) -> Iterator[str]:
    """Bytes, rows and columns."""
    data = table.store.read(f"{table.path}/{receipt.file}")
    if data is None:
        yield f"expected {receipt.file}, found no such file"
        return
    if (found := hashlib.sha256(data).hexdigest()) != receipt.sha256:
        yield f"expected sha256 {receipt.sha256[:12]}..., found {found[:12]}..."
        return
    description = table.description()
    try:
        rows = pq.read_table(pa.BufferReader(data), use_threads=False)
        schemas.check_version(description.schema, description.schema_version, "_table.json")
        # An earlier version had other columns; its bytes and digest are checked all the same.
        if description.schema_version == schemas.definition(description.schema)["version"]:
            schemas.check(description.schema, rows)
    except (RsaDataError, pa.ArrowException, OSError) as error:
        yield str(error)
        return
    if (len(rows), len(data)) != (receipt.rows, receipt.bytes):
        yield f"expected {receipt.rows} rows, {receipt.bytes} bytes; found {len(rows)}, {len(data)}"
    if schemas.digest(rows) != receipt.digest:
        yield "the content has another digest than the receipt says"
    if description.stage == "index":
        splits = pc.unique(rows["split"]).to_pylist()
        if splits != [receipt.split] or receipt.units != len(rows):
            yield f"expected {len(rows)} samples of {splits}, as its rows say; the receipt differs"
    yield from _account(work, table, receipt, rows)


def _account(work: WorkDir, table: Table, receipt: Receipt, rows: pa.Table) -> Iterator[str]:
    """The rows against those of the first input."""
    description = table.description()
    stage = stages.known(description.stage)
    for name in description.inputs[:1]:
        source = work.table(table.dataset, name)
        if receipt.part not in source.parts():
            yield f"its input {name} is not there any more"
        elif stage is not None:
            try:
                counts = parts.account(source.read(receipt.part), rows, stage.unit, str(table))
            except RsaDataError as error:
                yield str(error)
                continue
            if counts != {key: getattr(receipt, key) for key in counts}:
                yield f"expected {counts}, as its rows say; the receipt says otherwise"
