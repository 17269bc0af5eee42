"""What stands in a work dir: how far each table is, and what is out of date."""

from collections import Counter
from typing import Any

from ..cli.console import table_lines
from ..common.errors import RsaDataError
from ..common.units import size
from ..datasets import index
from ..heads.description import parse
from ..store import logs, schemas
from ..store.tables import Table, WorkDir, fingerprint
from . import stages

_ROWS = ("ok", "failed", "skipped")


def status(work: WorkDir) -> list[str]:
    """One line a table: parts, rows ok, failed, skipped, bytes, rate, and what is out of date."""
    lines: list[str] = []
    for dataset in work.datasets():
        total = len(work.table(dataset, "samples").parts())
        rows: list[list[Any]] = []
        for name in work.tables(dataset):
            table = work.table(dataset, name)
            parts, counts = table.parts(), Counter[str]()
            for receipt in table.receipts(parts):
                counts.update({key: receipt[key] for key in (*_ROWS, "bytes")})
            numbers = [f"{counts[key]:,}" for key in _ROWS]
            done = f"{len(parts)}/{total}"
            rate = logs.rate(logs.last_run(work, dataset, name))
            speed = "" if rate is None else f"{rate:,.1f}"
            rows.append([name, done, *numbers, size(counts["bytes"]), speed, stale(work, table)])
        header = ["table", "parts", "ok", "failed", "skipped", "size", "rows/s", ""]
        lines += [dataset, *("  " + line for line in table_lines(header, rows)), ""]
    for name in heads(work):
        lines.append(f"heads/{name}  {head_state(work, name)}".rstrip())
    return lines or [f"{work.store.location}: no dataset yet"]


def stale(work: WorkDir, table: Table) -> str:
    """Says how many parts are out of date, and what to do, or nothing."""
    description = table.description()
    stage = stages.STAGES.get(description["stage"])
    if stage is not None and description.get("stage_version") != stage.version:
        return "made by another version of its stage: --start-over makes it anew"
    if description.get("schema_version") not in (
        None,
        schemas.definition(description["schema"])["version"],
    ):
        return "of another schema version: --start-over makes it anew"
    old = outdated(work, table)
    return f"{len(old)} parts out of date" if old else ""


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
        raise RsaDataError(f"{table}: table.json: its inputs lead back to it")
    inputs = [work.table(table.dataset, name) for name in table.description().get("inputs", [])]
    old: set[int] = set()
    for source in inputs:
        if source.exists():
            if source.name not in known:
                known[source.name] = _outdated(work, source, known, digests, (*above, table.name))
            old |= known[source.name]
        if source.name not in digests:
            receipts = source.receipts(source.parts())
            digests[source.name] = {r["part"]: r["digest"] for r in receipts}
    changed = set()
    for receipt in table.receipts(table.parts()):
        number, made_from = receipt["part"], receipt.get("inputs", {})
        for source in inputs:
            if number in old or made_from.get(source.name) != digests[source.name].get(number):
                changed.add(number)
    return changed


def heads(work: WorkDir) -> list[str]:
    """Names of the finished heads."""
    names = [name[:-1] for name in work.store.list("heads") if name.endswith("/")]
    return [name for name in names if work.store.size(f"heads/{name}/head.json") is not None]


def head_state(work: WorkDir, name: str) -> str:
    """Whether the tables that a head was trained on are still the same ones, or nothing to say."""
    try:
        where = f"heads/{name}/head.json"
        description = parse(work.store.read(where) or b"{}", where)
    except RsaDataError as error:
        return f"damaged: {error}"
    changed = []
    for dataset, about in description.get("datasets", {}).items():
        if dataset not in work.datasets():
            continue
        try:
            splits = index.load_dataset(work, dataset).test_splits
        except RsaDataError:
            continue  # a dataset of a package that is not installed here
        samples = work.table(dataset, "samples")
        numbers = [n for n in samples.parts() if samples.receipt(n)["split"] not in splits]
        for table_name, digest in about.get("tables", {}).items():
            table = work.table(dataset, table_name)
            there = set(table.parts())
            digests = [table.receipt(n)["digest"] for n in numbers if n in there]
            if fingerprint(digests) != digest:
                changed.append(table.path)
    return f"out of date: trained before {', '.join(changed)} changed" if changed else ""
