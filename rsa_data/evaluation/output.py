"""What an evaluation leaves in the work dir, and whether it still belongs to its heads.

A folder holds metrics.parquet, summaries and plots, and last `_evaluation.json`, the commit: it
names the heads by digest, what was measured, and the sha256 of each file.
"""

import hashlib
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq

from .. import registry
from ..common.errors import RsaDataError
from ..common.typed import parse
from ..runner.collection import Collection
from ..store.encoding import to_json
from ..store.table_names import plain_name
from ..store.tables import WorkDir
from .formats import FORMATS
from .known_metrics import sources as metric_sources
from .options import Measuring
from .summary import Row

RECORD = "_evaluation.json"
_METRICS = "metrics.parquet"
_MARK = {b"record": RECORD.encode()}


class Record(msgspec.Struct, kw_only=True, frozen=True):
    """_evaluation.json.

    heads : sha256 of the head.json of each head measured, by name. datasets, split, protocol,
    beyond : what was measured, and how. files : sha256 by name. code : sha256 of the module of each
    protocol and metric that is not this package's.
    """

    heads: dict[str, str]
    datasets: list[str]
    split: str
    protocol: str
    beyond: str = "far"
    files: dict[str, str] = {}
    code: dict[str, str] | msgspec.UnsetType = msgspec.UNSET


@dataclass(frozen=True)
class Summary:
    """A summary in words: its title, rows, and notes behind them."""

    title: str
    rows: Sequence[Row]
    notes: Sequence[str]

    def files(self) -> dict[str, bytes]:
        """summary.md, .tex, .csv and .txt."""
        texts = {ending: form(self.rows) for ending, form in FORMATS.items()}
        notes = "\n".join(f"- {note}" for note in self.notes)
        texts["md"] = f"# {self.title}\n\n{texts['md']}\n{notes}\n"
        texts["txt"] = "\n".join([self.title, texts["txt"], *self.notes])
        return {f"summary.{ending}": text.encode() for ending, text in texts.items()}


def to_parquet(table: pa.Table) -> bytes:
    """A metrics table as a file, which says that a record belongs beside it."""
    buffer = io.BytesIO()
    pq.write_table(
        table.replace_schema_metadata({**(table.schema.metadata or {}), **_MARK}), buffer
    )
    return buffer.getvalue()


def heads_now(work: WorkDir, names: Iterable[str]) -> dict[str, str]:
    """sha256 of the head.json of each head, as it stands now."""
    found = {name: work.store.read(f"heads/{name}/head.json") for name in names}
    return {name: hashlib.sha256(data or b"").hexdigest() for name, data in found.items()}


def write(work: WorkDir, folder: str, files: Mapping[str, bytes], record: Record) -> None:
    """Writes the files, then the record that makes them an evaluation.

    record : `heads` as they were when they were loaded. Raises RsaDataError, and writes nothing,
    when one of them has been trained again since.
    """
    _unchanged(work, folder, record)
    work.store.delete(f"{folder}/{RECORD}")
    for name, content in files.items():
        work.store.write(f"{folder}/{name}", content)
    _unchanged(work, folder, record)
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    record = msgspec.structs.replace(record, files=digests)
    work.store.write(f"{folder}/{RECORD}", to_json(msgspec.to_builtins(record)))


def _unchanged(work: WorkDir, folder: str, record: Record) -> None:
    now = heads_now(work, record.heads)
    if changed := [name for name, digest in record.heads.items() if now[name] != digest]:
        raise RsaDataError(
            f"{work.store.location}/{folder}: the head {', '.join(changed)} was trained again or "
            "deleted while it was measured: nothing was written. Run the same command again"
        )


def record_of(heads: dict[str, str], datasets: Sequence[str], measuring: Measuring) -> Record:
    """The record of what is about to be written."""
    names = [(registry.PROTOCOLS, measuring.protocol)]
    names += [(registry.METRICS, name) for name in metric_sources()]
    found = [source for entries, name in names if (source := entries.source(name))]
    code = {source["code"]: source["code_sha256"] for source in found}
    return Record(
        code=code if code else msgspec.UNSET,
        heads=heads,
        datasets=list(datasets),
        split=measuring.split,
        protocol=measuring.protocol,
        beyond=measuring.beyond,
    )


def read_record(work: WorkDir, folder: str) -> Record | None:
    """The record of a folder; None where there is none. Raises RsaDataError when it is broken."""
    data = work.store.read(f"{folder}/{RECORD}")
    return None if data is None else parse(data, Record, f"{folder}/{RECORD}")


def folder_name(measuring: Measuring, datasets: Sequence[str]) -> str:
    """Folder of an evaluation: the protocol, and what was asked for beside the usual.

    datasets : those that were named; none for all. So that an evaluation of other datasets or of
    another split stands beside the first.
    """
    parts = [
        plain_name(measuring.protocol),
        *([measuring.beyond] if measuring.beyond != "far" else []),
        *([measuring.split] if measuring.split != "test" else []),
        *(["+".join(datasets)] * bool(datasets)),
    ]
    return ".".join(parts)


def problems_below(work: WorkDir, place: str) -> Iterator[str]:
    """What is wrong with the evaluations in the folders below a place, a sentence each."""
    for name in _folders(work, place):
        yield from _wrong(work, f"{place}/{name}")


def _folders(work: WorkDir, place: str) -> list[str]:
    return [name[:-1] for name in work.store.list(place) if name.endswith("/")]


def _wrong(work: WorkDir, folder: str) -> list[str]:
    try:
        found = read_record(work, folder)
    except RsaDataError as error:
        return [f"{error}. Run the evaluation again"]
    if found is None:
        return _without_record(work, folder)
    lines = []
    for name, digest in found.files.items():
        try:
            content = work.store.read(f"{folder}/{name}")
        except RsaDataError as error:
            lines.append(str(error))
            continue
        if content is None:
            lines.append(f"{folder}/{name}: expected this file; found none. Run it again")
        elif hashlib.sha256(content).hexdigest() != digest:
            lines.append(f"{folder}/{name}: damaged: its sha256 is not the one in {RECORD}")
    try:
        now = heads_now(work, found.heads)
    except RsaDataError:
        return lines  # said where the heads are checked
    lines += [
        f"{folder}: out of date: the head {name} was trained again since"
        for name, digest in found.heads.items()
        if now[name] != digest
    ]
    return lines


def _without_record(work: WorkDir, folder: str) -> list[str]:
    """Version 0.1 wrote no record, and its metrics do not say that there is one."""
    try:
        metrics = work.store.read(f"{folder}/{_METRICS}")
    except RsaDataError as error:
        return [str(error)]
    if metrics is not None:
        try:
            about = pq.read_schema(pa.BufferReader(metrics)).metadata or {}
        except (pa.ArrowException, OSError):
            about = _MARK
        if not _MARK.items() <= about.items():
            return []
    elif not work.store.list(folder):
        return []
    return [
        f"{folder}: expected {RECORD}; found none: it was deleted, or the evaluation was cut "
        "short. Run it again"
    ]


def _state(work: WorkDir, name: str) -> str:
    said = _wrong(work, f"comparisons/{name}")
    return said[0] if said else ""


COMPARISONS = Collection(
    names=lambda work: _folders(work, "comparisons"),
    check=lambda work, name: iter(_wrong(work, f"comparisons/{name}")),
    state=_state,
)
