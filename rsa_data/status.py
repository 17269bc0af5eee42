"""What stands in a work dir: how far each table is, and what is out of date."""

import json
from typing import Any

from . import index, logs, stages, tables
from .console import table_lines
from .errors import RsaDataError
from .parts import Parts, Work, fingerprint
from .units import size


def status(work: Work) -> list[str]:
    """One line a table: parts, rows ok, failed, skipped, bytes, rate, and what is out of date."""
    lines: list[str] = []
    for dataset in work.datasets():
        total = len(work.table(dataset, "samples").parts())
        rows: list[list[Any]] = []
        for name in work.tables(dataset):
            table = work.table(dataset, name)
            receipts = [table.receipt(number) for number in table.parts()]
            counts = [sum(r[k] for r in receipts) for k in ("ok", "failed", "skipped", "bytes")]
            *rows_done, used = counts
            numbers = [f"{count:,}" for count in rows_done]
            done = f"{len(receipts)}/{total}"
            rate = logs.rate(logs.last_run(work, dataset, name))
            speed = "" if rate is None else f"{rate:,.1f}"
            rows.append([name, done, *numbers, size(used), speed, stale(work, table)])
        header = ["table", "parts", "ok", "failed", "skipped", "size", "rows/s", ""]
        lines += [dataset, *("  " + line for line in table_lines(header, rows)), ""]
    for name in heads(work):
        lines.append(f"heads/{name}  {head_state(work, name)}".rstrip())
    return lines or [f"{work.store.location}: no dataset yet"]


def stale(work: Work, table: Parts) -> str:
    """Says how many parts are out of date, and what to do, or nothing."""
    description = table.description()
    stage = stages.STAGES.get(description["stage"])
    if stage is not None and description["stage_version"] != stage.version:
        return "made by another version of its stage: --start-over makes it anew"
    if description.get("schema_version") not in (
        None,
        tables.definition(description["schema"])["version"],
    ):
        return "of another schema version: --start-over makes it anew"
    old = outdated(work, table)
    return f"{len(old)} parts out of date" if old else ""


def outdated(work: Work, table: Parts) -> set[int]:
    """Parts made from an input that has changed since, or is itself out of date."""
    inputs = [work.table(table.dataset, name) for name in table.description()["inputs"]]
    there = {source.name: set(source.parts()) for source in inputs}
    old_inputs: set[int] = set()
    for source in inputs:
        if source.exists():
            old_inputs |= outdated(work, source)
    old = set()
    for number in table.parts():
        made_from = table.receipt(number).get("inputs", {})
        for source in inputs:
            known = number in there[source.name]
            digest = source.receipt(number)["digest"] if known else None
            if made_from.get(source.name) != digest or number in old_inputs:
                old.add(number)
    return old


def heads(work: Work) -> list[str]:
    """Names of the finished heads."""
    names = [name[:-1] for name in work.store.list("heads") if name.endswith("/")]
    return [name for name in names if work.store.size(f"heads/{name}/head.json") is not None]


def head_state(work: Work, name: str) -> str:
    """Whether the tables that a head was trained on are still the same ones, or nothing to say."""
    description = json.loads(work.store.read(f"heads/{name}/head.json") or b"{}")
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
