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

    For Hugging Face `datasets`, other readers of Parquet, or WebDataset; a data card is written
    beside it. With --depth, fitted scale and shift and the pixels of relative and metric depth.

    \b
      rsa-data export --format hf --out nyu-captions
      rsa-data export --format webdataset --depth depth-anything-v2-small --pictures --out shards
    """
    counts = call(run, WorkDir(work), out=out, **options)
    for name, rows in counts.items():
        click.echo(f"{name}: {rows:,} {'images' if options['format'] == 'webdataset' else 'rows'}")
    if options["format"] == "hf":
        click.echo(f"{out}: load_dataset({str(out)!r}, {next(iter(counts)).split('/')[0]!r})")
    else:
        click.echo(f"{out}: README.md says what it holds")
    if options["push"]:
        click.echo(f"uploaded to {options['push']}")
