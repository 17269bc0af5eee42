"""Export: captions, features and depth of a work dir as a dataset for other programs."""

import re
from pathlib import Path
from typing import Any, Literal

import pyarrow.parquet as pq

from ..common import files
from ..common.errors import RsaDataError, UsageError
from ..runner import jobs
from ..store import schemas
from ..store.outputs import check_output
from ..store.table_names import plain_name
from ..store.tables import Table, WorkDir
from . import data_card, export_rows, hub, webdataset


def export(
    work: WorkDir,
    *,
    out: Path,
    format: Literal["hf", "parquet", "webdataset"] = "hf",
    datasets: tuple[str, ...] = (),
    embeddings: str | None = None,
    depth: str | None = None,
    pictures: bool = False,
    push: str | None = None,
) -> dict[str, int]:
    """Writes captions with their features, and depth and pictures on request, with a data card.

    Parameters
    ----------
    out : folder to write; it must not be there yet.
    format : hf is what Hugging Face `datasets` opens: Parquet with list columns, one configuration
        a dataset. parquet is the same files for other readers. webdataset writes tar shards, a few
        members an image.
    datasets : which datasets of the work dir; all that have such features by default.
    embeddings : which features, as STYLE/ENCODER, where there are several.
    depth : depth table to add, such as depth-anything-v2-small: fitted scale and shift of each
        image, relative and metric pixels.
    pictures : whether to copy the images themselves.
    push : OWNER/NAME of a dataset on the Hugging Face hub to upload the folder to.

    Returns the rows (images, for webdataset) of each configuration and split, by `DATASET/SPLIT`.
    Raises UsageError when the folder is there already, RsaDataError when there is nothing to export
    or a part of a table is missing: an export is whole.
    """
    if out.exists():
        raise UsageError(f"--out {out}: expected a folder that is not there yet")
    check_output(out, "--out", folder=True)
    if push is not None and not re.fullmatch(r"[\w.-]+/[\w.-]+", push):
        raise UsageError(f"--push: expected OWNER/NAME, found {push!r}")
    embeddings, depth = (name and plain_name(name) for name in (embeddings, depth))
    names = list(datasets) or [n for n in work.datasets() if _has(work, n, embeddings)]
    if not names:
        raise RsaDataError(
            f"{work.store.location}: no dataset with embeddings"
            f"{f'/{embeddings}' if embeddings else ''}. Make them first: "
            f"rsa-data embed{work.option}"
        )
    chosen = {name: _chosen(work, name, embeddings, depth, pictures) for name in names}
    begun = {name: _state(c.embeddings) for name, c in chosen.items()}
    try:
        with files.appearing(out) as unfinished:
            counts = _write(work, chosen, unfinished, format)
            for name, tables in chosen.items():
                if _state(tables.embeddings) != begun[name]:
                    raise RsaDataError(
                        f"{tables.embeddings}: was changed while it was exported. Run the same "
                        "command again"
                    )
    except OSError as error:
        raise RsaDataError(f"--out {out}: cannot be written: {error.strerror or error}") from error
    if push is not None:
        hub.push(out, push)
    return counts


def _write(
    work: WorkDir, chosen: dict[str, export_rows.Chosen], folder: Path, format: str
) -> dict[str, int]:
    """Writes all parts and the data card; returns the rows, or images, by DATASET/SPLIT."""
    counts: dict[str, int] = {}
    for name, tables in chosen.items():
        for number, split in export_rows.parts(tables).items():
            rows = export_rows.rows(tables, number)
            file = folder / name / f"{split}-{number:05d}"
            file.parent.mkdir(parents=True, exist_ok=True)
            if format == "webdataset":
                count = webdataset.write(rows, file.with_suffix(".tar"))
            else:
                file = file.with_suffix(".parquet")
                pq.write_table(rows, file, row_group_size=20_000, compression="zstd")
                count = len(rows)
            key = f"{name}/{split}"
            counts[key] = counts.get(key, 0) + count
    text = data_card.card(work, {n: c.embeddings for n, c in chosen.items()}, counts, format)
    (folder / "README.md").write_text(text, "utf-8")
    return counts


def _state(table: Table) -> tuple[Any, list[str]]:
    """What an export is made from: the description and the parts."""
    numbers = table.parts()
    return table.description(), [receipt.sha256 for receipt in table.receipts(numbers)]


def _chosen(
    work: WorkDir, name: str, embeddings: str | None, depth: str | None, pictures: bool
) -> export_rows.Chosen:
    features = jobs.choose(work, name, "embeddings", embeddings, "--embeddings STYLE/ENCODER")
    schema = work.table(name, features).description().schema
    if "embedding" not in schemas.schema(schema).names:
        raise UsageError(
            f"{name}/{features}: expected a feature of each text or image; this table holds "
            f"{schema}. Choose another one with --embeddings, or open it with open_work in Python"
        )
    beside = jobs.choose(work, name, "depth", depth, "--depth MODEL") if depth else None
    return export_rows.Chosen(
        work,
        work.table(name, features),
        work.table(name, beside) if beside else None,
        export_rows.root_of(work, name) if pictures else None,
    )


def _has(work: WorkDir, dataset: str, embeddings: str | None) -> bool:
    prefix = f"embeddings/{embeddings}" if embeddings else "embeddings/"
    return any(name.startswith(prefix) for name in work.tables(dataset))
