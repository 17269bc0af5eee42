"""The command that hands data on: export."""

from pathlib import Path
from typing import Any

import click

from ..common.options import call
from ..store.tables import WorkDir
from ..views.export import export as run
from .options import click_options
from .shared import work_option


@click.command()
@work_option
@click_options(run)
def export(work: str, out: Path, **options: Any) -> None:
    """Write captions and features as a dataset.

    Hugging Face `datasets` loads it; a data card is written beside it.

    \b
      rsa-data export --format hf --out nyu-captions
    """
    counts = call(run, WorkDir(work), out=out, **options)
    for name, rows in counts.items():
        click.echo(f"{name}: {rows:,} rows")
    click.echo(f"{out}: load_dataset({str(out)!r}, {next(iter(counts)).split('/')[0]!r})")
