"""What a work dir holds: how far each table is, and what is out of date."""

from collections import Counter
from typing import Any

from .. import registry
from ..common.errors import RsaDataError
from ..common.tables import table_lines
from ..common.units import size
from ..store import logs, schemas
from ..store.tables import Table, WorkDir
from . import stages
from .collection import Collection
from .cpu import mixed

_ROWS = ("ok", "failed", "skipped")


def status(work: WorkDir) -> list[str]:
    """One line a table: parts, rows ok, failed, skipped, bytes, rate, and what is out of date."""
    need_work_dir(work)
    lines: list[str] = []
    for dataset in work.datasets():
        total = len(work.table(dataset, "samples").parts())
        rows: list[list[Any]] = []
        for name in work.tables(dataset):
            table = work.table(dataset, name)
            parts, counts, cpus = table.parts(), Counter[str](), Counter[str]()
            for receipt in table.receipts(parts):
                counts.update({key: getattr(receipt, key) for key in (*_ROWS, "bytes")})
                cpus[receipt.cpu] += 1
            numbers = [f"{counts[key]:,}" for key in _ROWS]
            done = f"{len(parts)}/{total}"
            rate = logs.rate(logs.last_run(work, dataset, name))
            speed = "" if rate is None else f"{rate:,.1f}"
            rows.append(
                [name, done, *numbers, size(counts["bytes"]), speed, _state(work, table, cpus)]
            )
        header = ["table", "parts", "ok", "failed", "skipped", "size", "rows/s", ""]
        lines += [dataset, *("  " + line for line in table_lines(header, rows)), ""]
    for folder, collection in collections():
        for name in collection.names(work):
            lines.append(f"{folder}/{name}  {collection.state(work, name)}".rstrip())
    return lines or [f"{work.store.location}: no dataset there yet"]


def need_work_dir(work: WorkDir) -> None:
    """Raises RsaDataError unless the work dir holds something."""
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
        if source.exists():
            if source.name not in known:
                known[source.name] = _outdated(work, source, known, digests, (*above, table.name))
            old |= known[source.name]
        if source.name not in digests:
            receipts = source.receipts(source.parts())
            digests[source.name] = {r.part: r.digest for r in receipts}
    changed = set()
    for receipt in table.receipts(table.parts()):
        number, made_from = receipt.part, receipt.inputs
        for source in inputs:
            if number in old or made_from.get(source.name) != digests[source.name].get(number):
                changed.add(number)
    return changed
