"""The command that hands data on: export."""

from pathlib import Path
from typing import Any

import click

from ..common.options import click_options
from ..store.tables import WorkDir
from ..views.export import export as run
from .shared import work_option


@click.command()
@work_option
@click_options(run)
def export(work: str, out: Path, **options: Any) -> None:
    """Write captions and features as a dataset for Hugging Face `datasets`, with its card.

    \b
      rsa-data export --format hf --out nyu-captions
    """
    counts = run(WorkDir(work), out=out, **options)
    for name, rows in counts.items():
        click.echo(f"{name}: {rows:,} rows")
    click.echo(f"{out}: load_dataset({str(out)!r}, {next(iter(counts)).split('/')[0]!r})")
