"""Whether a work dir is whole, and is what its descriptions and receipts say."""

import re
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

from ..common.errors import RsaDataError
from ..common.typed import parse
from ..common.units import size
from ..datasets import index
from ..datasets.found_samples import check_once
from ..store.receipts import LOCAL, is_table
from ..store.table_names import KEPT
from ..store.tables import Table, WorkDir
from . import status
from .check_parts import Checked, check_part
from .cpu import mixed

Report = Callable[[str], Any]

# What only a table's folder holds.
_PART = re.compile(r"_?part-\d{5,}.*|_?manifest\.json")

# Part numbers that a message lists; the others are counted.
_LISTED = 5


def verify(work: WorkDir, report: Report) -> int:
    """Reads everything in a work dir again. Reports each problem; returns how many there are.

    Checked from the samples downwards: every part is there; data, receipts, manifests, descriptions
    and fingerprints agree with each other, with the samples and with the inputs; schema versions
    are known; nothing else lies among the parts. Then the heads and what else a work dir holds, see
    `registry.COLLECTIONS`.

    Raises RsaDataError when there is no work dir.
    """
    status.need_work_dir(work)
    checked, problems = Checked(), 0
    for dataset in _datasets(work):
        for problem in _guarded(_check_dataset(work, dataset, checked)):
            report(problem)
            problems += 1
    for folder, collection in status.collections():
        for name in collection.names(work):
            for problem in _guarded(collection.check(work, name)):
                report(f"{work.store.location}/{folder}/{name}: {problem}")
                problems += 1
            checked.others += 1
    for note in checked.notes:
        report(f"note: {note}")
    read = f"{checked.parts} parts, {size(checked.bytes)} and {checked.others} heads and results"
    report(f"{read} read: {problems or 'no'} problems")
    return problems


def _guarded(problems: Iterator[str]) -> Iterator[str]:
    """The problems; that one of them kept the rest from being read is a problem too."""
    try:
        yield from problems
    except RsaDataError as error:
        yield str(error)


def _datasets(work: WorkDir) -> list[str]:
    """Folders that hold tables, or what is left of tables."""
    names = [name[:-1] for name in work.store.list("") if name.endswith("/")]
    return [name for name in names if name not in KEPT and _has_tables(work, name)]


def _has_tables(work: WorkDir, dataset: str) -> bool:
    try:
        return bool(_folders(work, dataset))
    except RsaDataError:
        return True  # said where it is checked


def _folders(work: WorkDir, dataset: str) -> list[tuple[str, bool]]:
    """(folder, whether a description lies there) of each table, and of parts without one."""
    found, waiting = [], [""]
    while waiting:
        folder = waiting.pop()
        names = work.store.list(f"{dataset}/{folder}")
        if is_table(names) or any(_PART.fullmatch(name) for name in names):
            found.append((folder.rstrip("/"), is_table(names)))
        waiting += [folder + name for name in names if name.endswith("/")]
    return sorted(found, key=lambda f: (f[0] != "samples", f))


def _check_dataset(work: WorkDir, dataset: str, checked: Checked) -> Iterator[str]:
    folders = _folders(work, dataset)
    samples = work.table(dataset, "samples")
    if "samples" not in [name for name, _ in folders]:
        yield f"{samples}: expected the samples of this dataset; found none"
    yield from _root(work, dataset, checked)
    for name, described in folders:
        table = work.table(dataset, name)
        yield from _local(table)
        if not described:
            yield f"{table}: expected _table.json, which says what made these parts; found none"
            continue
        try:
            expected = _expected(table, samples)
            yield from _check_table(work, table, expected, checked)
        except RsaDataError as error:
            yield str(error)


def _root(work: WorkDir, dataset: str, checked: Checked) -> Iterator[str]:
    """Where the dataset's files lie is known, or not: on another machine that is no problem."""
    place = f"{work.store.location}/{dataset}"
    try:
        if index.find_root(work, dataset) is None:
            checked.notes.append(
                f"{place}: it is not known where the dataset's files lie, or they are not there: "
                "commands that read them need --root"
            )
    except RsaDataError as error:
        yield str(error)


def _local(table: Table) -> Iterator[str]:
    """_local.json, which may be missing."""
    path = table.helper(LOCAL)
    try:
        if (data := table.store.read(path)) is not None:
            parse(data, dict[str, Any], f"{table.store.location}/{path}")
    except RsaDataError as error:
        yield f"{error}. Delete it: the next run writes it again"


def _expected(table: Table, samples: Table) -> list[int]:
    """Numbers of the parts that a finished table has."""
    numbers = samples.parts()
    return list(range(max(numbers, default=-1) + 1)) if table.name == samples.name else numbers


def _check_table(
    work: WorkDir, table: Table, expected: list[int], checked: Checked
) -> Iterator[str]:
    there = table.parts()
    if missing := sorted(set(expected) - set(there)):
        what = f"{len(missing)} of {len(expected)} parts are missing: {_listed(missing)}"
        yield f"{table}: {what}. Run the command of this table again"
    if more := sorted(set(there) - set(expected)):
        yield f"{table}: part {_listed(more)}: expected parts of the samples only"
    manifest, whole = None, True
    try:
        manifest = table.stored_manifest()
    except RsaDataError as error:
        whole = False
        yield str(error)
    merged = {receipt.part: receipt for receipt in manifest.parts} if manifest else {}
    if manifest is None and whole and there and there == expected:
        yield (
            f"{table}: expected _manifest.json, since all parts are there; found none. Run the "
            "command of this table again"
        )
    if lost := sorted(set(merged) - set(there)):
        yield f"{table}: the manifest lists part {_listed(lost)}, which has no receipt"
    old = status.outdated(work, table)
    cpus, files = Counter[str](), set[str]()
    unfounded: list[int] = []
    sound: list[int] = []
    for number in there:
        try:
            receipt = table.receipt(number)
        except RsaDataError as error:
            yield str(error)
            continue
        try:
            found, founded = check_part(work, table, number, receipt, checked)
        except RsaDataError as error:
            found, founded = [str(error)], True
        if not founded:
            unfounded.append(number)
        if number in old:
            found.append("its input has changed since: run the stage again")
        if manifest is not None and merged.get(number) != receipt:
            found.append("the manifest has another receipt: run the stage again")
        sound += [] if found else [number]
        for text in found:
            yield f"{table} part {number}: {text}"
        cpus[receipt.cpu] += 1
        files.add(receipt.file)
    if unfounded:
        yield (
            f"{table}: part {_listed(unfounded)}: the fingerprint does not follow from _table.json "
            "and the inputs: one of them was edited. Use --start-over to make the table again"
        )
    if table.name == "samples":
        check_once(table, sound)
    if note := mixed(cpus):
        checked.notes.append(f"{table}: {note}")
    if manifest is not None and (strange := table.leftovers(files)):
        yield f"{table}: expected its parts only; found {', '.join(strange[:_LISTED])}"


def _listed(numbers: list[int]) -> str:
    more = f" and {len(numbers) - _LISTED} more" if len(numbers) > _LISTED else ""
    return ", ".join(map(str, numbers[:_LISTED])) + more
