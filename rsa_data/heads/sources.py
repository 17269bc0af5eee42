"""Which tables of a work dir a head learns from or is measured on."""

from collections.abc import Sequence

from .. import registry
from ..common.errors import RsaDataError, UsageError, unknown
from ..store.tables import WorkDir
from .belong import Source, Tables
from .inputs import kinds
from .inputs.kinds import Feed


def sources(work: WorkDir, tables: Tables, head: str, reads: Sequence[str]) -> list[Source]:
    """The tables to learn from, one entry a dataset; what is not named must be the only one there.

    head, reads : name of the head, for messages, and the kinds of input that its class declares.

    Raises UsageError when a choice is open, RsaDataError when a table is missing.
    """
    there = work.datasets()
    for name in tables.datasets:
        if name not in there:
            raise unknown("dataset in this work dir", name, there)
    if not there:
        raise RsaDataError(
            f"{work.store.location}: no dataset there yet. Begin with "
            "`rsa-data captions --dataset NAME`, or name another --work"
        )
    if reads and tables.style and not _has_style(reads, tables.style):
        raise UsageError(f"--head {head} reads {' and '.join(reads)}; found --style {tables.style}")
    found = []
    for name in tables.datasets or there:
        names = work.tables(name)
        depths = [t for t in names if t.startswith("depth/")]
        depth = _only(
            name,
            "depth",
            [t for t in depths if tables.depth_model in (None, t.partition("/")[2])],
            "--depth-model",
            f"rsa-data depth --dataset {name} --depth-model "
            f"{tables.depth_model or 'depth-anything-v2-small'}{work.option}",
        )
        found.append(Source(name, depth, tuple(_inputs(work, name, names, tables, reads))))
    return found


def _has_style(reads: Sequence[str], style: str) -> bool:
    folders = {name: kinds.kind(name).folder for name in registry.INPUTS}
    if style in folders.values():
        return "text" not in reads and any(folders[name] == style for name in reads)
    return "text" in reads


def _inputs(
    work: WorkDir, dataset: str, names: Sequence[str], tables: Tables, reads: Sequence[str]
) -> list[Feed]:
    """The inputs of a head on one dataset whose tables are `names`."""
    encoders: list[str | None] = [*(tables.encoder.split("+") if tables.encoder else [])]
    if not reads and len(encoders) == 2:
        reads = ("text", "image")
    if len(encoders) > max(len(reads), 1):
        raise UsageError(
            f"--encoder {tables.encoder}: expected one for each of {', '.join(reads) or 'text'}"
        )
    # One encoder for several inputs is the first one's; the others must be the only ones there.
    encoders += [None] * (max(len(reads), 1) - len(encoders))
    feeds = [kinds.feed(table) for table in names if table.startswith("embeddings/")]
    if not reads:
        vectors = [feed for feed in feeds if kinds.kind(feed.kind).vector]
        good = [f for f in vectors if tables.style in (None, f.style)]
        return [_chosen(dataset, good, encoders[0], f"rsa-data embed{work.option}")]
    found = []
    for name, encoder in zip(reads, encoders, strict=True):
        own = kinds.kind(name)
        if own.table:
            found.append(Feed(name, own.table))
            continue
        good = [feed for feed in feeds if feed.kind == name]
        if name == "text":
            good = [feed for feed in good if tables.style in (None, feed.style)]
        found.append(_chosen(dataset, good, encoder, f"{own.made_by}{work.option}"))
    return found


def _chosen(dataset: str, feeds: list[Feed], encoder: str | None, make: str) -> Feed:
    by_name = {feed.table: feed for feed in feeds if encoder in (None, feed.encoder)}
    return by_name[_only(dataset, "embeddings", list(by_name), "--style and --encoder", make)]


def _only(dataset: str, kind: str, found: list[str], by: str, make: str) -> str:
    if not found:
        raise RsaDataError(f"{dataset}: no such {kind} table. Make it first: {make}")
    if len(found) > 1:
        names = ", ".join(name.partition("/")[2] for name in found)
        raise UsageError(f"{dataset}: several {kind} tables; say which by {by}: {names}")
    return found[0]
