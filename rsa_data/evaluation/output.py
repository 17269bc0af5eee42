"""What an evaluation leaves in the work dir: the metrics table, and its summary in four formats."""

import io
from collections.abc import Sequence

import pyarrow as pa
import pyarrow.parquet as pq

from ..store import schemas
from ..store.tables import WorkDir
from .formats import FORMATS
from .summary import Row


def write(
    work: WorkDir,
    folder: str,
    table: pa.Table,
    rows: Sequence[Row],
    title: str,
    notes: Sequence[str],
) -> str:
    """Writes metrics.parquet and summary.{md,tex,csv,txt} to `folder`; returns summary.txt."""
    schemas.check("metrics", table)
    buffer = io.BytesIO()
    pq.write_table(table, buffer)
    work.store.write(f"{folder}/metrics.parquet", buffer.getvalue())
    texts = {ending: form(rows) for ending, form in FORMATS.items()}
    texts["md"] = f"# {title}\n\n{texts['md']}\n" + "\n".join(f"- {note}" for note in notes) + "\n"
    texts["txt"] = "\n".join([title, texts["txt"], *notes])
    for ending, content in texts.items():
        work.store.write(f"{folder}/summary.{ending}", content.encode())
    return texts["txt"] + f"\nin {work.store.location}/{folder}"
