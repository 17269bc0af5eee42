"""Which tables of a work dir a head learns from or is measured on."""

from collections.abc import Callable, Sequence
from functools import partial

from .. import registry
from ..common.errors import RsaDataError, UsageError, unknown
from ..runner.commands import making
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
    found, names = [], tables.datasets or there
    for name in names:
        try:
            found.append(_source(work, name, tables, reads))
        except _Missing as missing:
            others = [
                other for other in names if other != name and missing.fits(work.tables(other))
            ]
            without = f", or leave it out: {' '.join(f'--datasets {other}' for other in others)}"
            raise RsaDataError(f"{missing}{without if others else ''}") from None
    return found


class _Missing(RsaDataError):
    """No table of a dataset is wanted; fits : whether one of these names is."""

    def __init__(self, said: str, fits: Callable[[Sequence[str]], bool]):
        super().__init__(said)
        self.fits = fits


def _source(work: WorkDir, dataset: str, tables: Tables, reads: Sequence[str]) -> Source:
    wanted = tables.depth_model

    def among(names: Sequence[str]) -> list[str]:
        return [n for n in names if n.startswith("depth/") and wanted in (None, n[6:])]

    alike = [name for other in work.datasets() for name in among(work.tables(other))]
    usual = f"depth/{wanted or 'depth-anything-v2-small'}"
    exact = f"depth/{wanted or '...'}"
    depth = _only(work, dataset, [*alike[:1], usual, exact], among, "--depth-model")
    return Source(dataset, depth, tuple(_inputs(work, dataset, tables, reads)))


def _has_style(reads: Sequence[str], style: str) -> bool:
    folders = {name: kinds.kind(name).folder for name in registry.INPUTS}
    if style in folders.values():
        return "text" not in reads and any(folders[name] == style for name in reads)
    return "text" in reads


def _inputs(work: WorkDir, dataset: str, tables: Tables, reads: Sequence[str]) -> list[Feed]:
    """The inputs of a head on one dataset."""
    encoders: list[str | None] = [*(tables.encoder.split("+") if tables.encoder else [])]
    if not reads and len(encoders) == 2:
        reads = ("text", "image")
    if len(encoders) > max(len(reads), 1):
        raise UsageError(
            f"--encoder {tables.encoder}: expected one for each of {', '.join(reads) or 'text'}"
        )
    # One encoder for several inputs is the first one's; the others must be the only ones there.
    encoders += [None] * (max(len(reads), 1) - len(encoders))
    if not reads:
        vectors = partial(_feeds, style=tables.style, encoder=encoders[0], kind=None)
        return [_chosen(work, dataset, vectors, (tables.style, encoders[0]))]
    found = []
    for name, encoder in zip(reads, encoders, strict=True):
        own = kinds.kind(name)
        if own.table:
            found.append(Feed(name, own.table))
            continue
        style = tables.style if name == "text" else None
        among = partial(_feeds, style=style, encoder=encoder, kind=name)
        found.append(_chosen(work, dataset, among, (own.folder or style, encoder)))
    return found


def _feeds(
    names: Sequence[str], style: str | None, encoder: str | None, kind: str | None
) -> list[str]:
    """The embeddings tables that fit; kind : of input, None for any that is one vector."""
    feeds = [kinds.feed(table) for table in names if table.startswith("embeddings/")]
    return [
        feed.table
        for feed in feeds
        if style in (None, feed.style)
        and encoder in (None, feed.encoder)
        and (kinds.kind(feed.kind).vector if kind is None else feed.kind == kind)
    ]


def _chosen(
    work: WorkDir,
    dataset: str,
    among: Callable[[Sequence[str]], list[str]],
    wanted: tuple[str | None, str | None],
) -> Feed:
    """wanted : folder or style, and encoder, as far as they are given."""
    style, encoder = wanted
    exact = [f"embeddings/{style or '...'}/{encoder or '...'}"]
    alike = [name for other in work.datasets() for name in among(work.tables(other))]
    by = "--style and --encoder"
    return kinds.feed(_only(work, dataset, [*alike[:1], *exact], among, by))


def _only(
    work: WorkDir,
    dataset: str,
    wanted: Sequence[str],
    among: Callable[[Sequence[str]], list[str]],
    by: str,
) -> str:
    """The only table of a dataset that fits.

    wanted : the name of one that would, as other datasets have it, and as it was asked for.
    among : names -> those that fit. by : the options that choose.
    """
    names = work.tables(dataset)
    kind = wanted[-1].partition("/")[0]
    found = among(names)
    if len(found) > 1:
        # What was refused or stopped at once may have left a table without any part.
        found = [name for name in found if work.table(dataset, name).parts()] or found
    if len(found) > 1:
        told = ", ".join(name.partition("/")[2] for name in found)
        raise UsageError(f"{dataset}: several {kind} tables; say which by {by}: {told}")
    if found:
        return found[0]
    there = [name.partition("/")[2] for name in names if name.startswith(f"{kind}/")]
    raise _Missing(
        f"{dataset}: no such {kind} table: expected {wanted[-1]}; found "
        f"{', '.join(there) or 'none'}. Make it first: {making(work, dataset, wanted[0])}",
        lambda others: bool(among(others)),
    )
