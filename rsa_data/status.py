"""What stands in a work dir, and whether it is what its receipts say."""

import hashlib
from collections.abc import Callable
from typing import Any

from . import tables
from .console import size, table_lines
from .errors import RsaDataError
from .parts import Parts, Work


def status(work: Work) -> list[str]:
    """One line a table: parts, rows ok, failed, skipped, bytes, and what is out of date."""
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
            rows.append([name, done, *numbers, size(used), stale(work, table)])
        header = ["table", "parts", "ok", "failed", "skipped", "size", ""]
        lines += [dataset, *("  " + line for line in table_lines(header, rows)), ""]
    return lines or [f"{work.store.location}: no dataset yet"]


def stale(work: Work, table: Parts) -> str:
    """Says how many parts were made from an input that has changed since, or nothing."""
    inputs = [work.table(table.dataset, name) for name in table.description()["inputs"]]
    old = 0
    for number in table.parts():
        made_from = table.receipt(number).get("inputs", {})
        for source in inputs:
            there = source.parts()
            digest = source.receipt(number)["digest"] if number in there else None
            if made_from.get(source.name) != digest:
                old += 1
                break
    return f"{old} parts out of date" if old else ""


def verify(work: Work, say: Callable[[str], Any]) -> int:
    """Reads every part of every table again. Says each problem; returns how many there are.

    Checked: bytes and sha256 against the receipt, schema, digest of the content, rows accounted
    for against the input, and that no part came from an input that has changed since.
    """
    problems = 0
    checked = total = 0
    for dataset in work.datasets():
        for name in work.tables(dataset):
            table = work.table(dataset, name)
            description = table.description()
            for number in table.parts():
                found = list(_check(work, table, description, number))
                for text in found:
                    say(f"{table} part {number}: {text}")
                problems += len(found)
                checked += 1
                total += table.receipt(number)["bytes"]
    say(f"{checked} parts, {size(total)} read: {problems or 'no'} problems")
    return problems


def _check(work: Work, table: Parts, description: dict[str, Any], number: int) -> Any:
    receipt = table.receipt(number)
    data = table.store.read(f"{table.path}/{receipt['file']}")
    if data is None:
        yield "expected a file, found none"
        return
    if (found := hashlib.sha256(data).hexdigest()) != receipt["sha256"]:
        yield f"expected sha256 {receipt['sha256'][:12]}..., found {found[:12]}..."
        return
    try:
        rows = table.read(number)
        tables.check(description["schema"], rows)
    except RsaDataError as error:
        yield str(error)
        return
    if tables.digest(rows) != receipt["digest"]:
        yield "the content has another digest than the receipt says"
    for name, digest in receipt.get("inputs", {}).items():
        source = work.table(table.dataset, name)
        if number not in source.parts():
            yield f"its input {name} is not there any more"
        elif source.receipt(number)["digest"] != digest:
            yield f"its input {name} has changed since: run the stage again"
