"""What a work dir holds: how far each table is, and what is out of date."""

import os
import shlex
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .. import registry
from ..common.errors import RsaDataError
from ..common.tables import table_lines
from ..common.units import size
from ..store import logs, schemas
from ..store.local import LocalStore
from ..store.outputs import is_dataset
from ..store.tables import Receipt, Table, WorkDir
from . import stages
from .collection import Collection
from .cpu import mixed

_ROWS = ("ok", "failed", "skipped")


@dataclass
class Status:
    """What a work dir holds, in lines; broken : what could not be read, a sentence each."""

    lines: list[str] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)

    def add(self, problem: str) -> None:
        """Adds what could not be read, once."""
        if problem not in self.broken:
            self.broken.append(problem)


def status(work: WorkDir) -> Status:
    """One line a table: parts, rows ok, failed, skipped, bytes, rate, and what is out of date."""
    need_work_dir(work)
    found = Status()
    for dataset in work.datasets():
        try:
            total = len(work.table(dataset, "samples").parts())
            tables = [work.table(dataset, name) for name in work.tables(dataset)]
        except RsaDataError as error:
            found.lines += [f"{dataset}  cannot be read, see below", ""]
            found.add(str(error))
            continue
        rows = [_row(table, total, work, found) for table in tables]
        header = ["table", "parts", "ok", "failed", "skipped", "size", "rows/s", ""]
        found.lines += [dataset, *("  " + line for line in table_lines(header, rows)), ""]
    for folder, collection in collections():
        for name in collection.names(work):
            try:
                state = collection.state(work, name)
            except RsaDataError as error:
                state = "cannot be read, see below"
                found.add(str(error))
            found.lines.append(f"{folder}/{name}  {state}".rstrip())
    found.lines = found.lines or [f"{work.store.location}: no dataset there yet"]
    return found


def _row(table: Table, total: int, work: WorkDir, found: Status) -> list[Any]:
    """The line of a table; of one that is broken what can be read."""
    parts, counts, cpus = table.parts(), Counter[str](), Counter[str]()
    wrong: list[str] = []
    for receipt in readable(table, parts, wrong):
        counts.update({key: getattr(receipt, key) for key in (*_ROWS, "bytes")})
        cpus[receipt.cpu] += 1
    state, rate = "cannot be read, see below", None
    try:
        rate = logs.rate(logs.last_run(work, table.dataset, table.name))
        state = state if wrong else _state(work, table, cpus)
    except RsaDataError as error:
        wrong.append(str(error))
    for text in wrong:
        found.add(text)
    speed = "" if rate is None else f"{rate:,.1f}"
    numbers = [f"{counts[key]:,}" for key in _ROWS]
    return [table.name, f"{len(parts)}/{total}", *numbers, size(counts["bytes"]), speed, state]


def readable(table: Table, numbers: list[int], wrong: list[str]) -> Iterator[Receipt]:
    """The receipts that can be read; what is wrong with the others is added to `wrong`."""
    while numbers:
        done = 0
        try:
            for receipt in table.receipts(numbers):
                done += 1
                yield receipt
        except RsaDataError as error:
            wrong.append(str(error))
            done += 1
        numbers = numbers[done:]


def need_work_dir(work: WorkDir) -> None:
    """Raises RsaDataError unless the work dir holds something, and is no folder inside of one."""
    place = Path(work.store.location)
    if isinstance(work.store, LocalStore) and is_dataset(place):
        raise RsaDataError(
            f"{place}: expected a work dir; found the folder of a dataset in one. Use "
            f"--work {shlex.quote(str(Path(os.path.realpath(place)).parent))}"
        )
    if not work.store.list(""):
        raise RsaDataError(
            f"{work.store.location}: expected a work dir; found nothing there. Name it by --work, "
            "or begin one: rsa-data captions --dataset NAME"
        )


def collections() -> list[tuple[str, Collection]]:
    """What a work dir holds beside datasets, by folder."""
    table = registry.COLLECTIONS
    return [(name, registry.resolve("collection", table, name)) for name in table]


def stale(work: WorkDir, table: Table) -> str:
    """How many parts are out of date or not done, or why all are and what to do; "" for none."""
    description = table.description()
    stage = stages.known(description.stage)
    if stage is not None and description.stage_version != stage.version:
        return "made by another version of its stage: use --start-over to make it again"
    if description.schema_version != schemas.definition(description.schema)["version"]:
        return "of another schema version: use --start-over to make it again"
    old, missing = outdated(work, table), table.missing()
    said = [f"{len(old)} parts out of date"] if old else []
    said += [f"{len(missing)} parts are not done"] if missing else []
    return "; ".join(said)


def _state(work: WorkDir, table: Table, cpus: Counter[str]) -> str:
    several = "made on several types of CPU" if mixed(cpus) else ""
    return "; ".join(filter(None, (stale(work, table), several)))


def outdated(work: WorkDir, table: Table) -> set[int]:
    """Parts made from an input that has changed since, or is itself out of date."""
    return _outdated(work, table, {}, {}, ())


def _outdated(
    work: WorkDir,
    table: Table,
    known: dict[str, set[int]],
    digests: dict[str, dict[int, str]],
    above: tuple[str, ...],
) -> set[int]:
    """known, digests : by table, what has been found out so far; every receipt is read once.

    above : tables that are made from this one; raises RsaDataError when it is among them.
    """
    if table.name in above:
        raise RsaDataError(f"{table}: its inputs lead back to it")
    inputs = [work.table(table.dataset, name) for name in table.description().inputs]
    old: set[int] = set()
    for source in inputs:
        if _described(source):
            if source.name not in known:
                known[source.name] = _outdated(work, source, known, digests, (*above, table.name))
            old |= known[source.name]
        if source.name not in digests:
            numbers = source.parts()
            digests[source.name] = dict.fromkeys(numbers, _UNKNOWN) | {
                receipt.part: receipt.digest for receipt in readable(source, numbers, [])
            }
    changed = set()
    for receipt in readable(table, table.parts(), []):
        number, made_from = receipt.part, receipt.inputs
        for source in inputs:
            now = digests[source.name].get(number)
            if number in old or now not in (made_from.get(source.name), _UNKNOWN):
                changed.add(number)
    return changed


# In place of the digest of a part whose receipt is broken: that is told of its own table.
_UNKNOWN = "unknown"


def _described(table: Table) -> bool:
    """Whether a table is there, with a description that can be read."""
    try:
        return table.exists() and bool(table.description())
    except RsaDataError:
        return False
