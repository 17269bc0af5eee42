"""The commands about models: what is there, fetching, checking."""

import json
from pathlib import Path
from typing import Any

import click

from ..common import files
from ..common.errors import RsaDataError
from ..common.tables import table_lines
from ..store.outputs import check_output, identities
from ..views.models import check as checking
from ..views.models import listing
from .options import FilePath
from .shared import key_values


@click.group(invoke_without_command=True)
@click.pass_context
def models(ctx: click.Context) -> None:
    """Show, fetch and check models.

    Without a command: each model, whether its file is on this machine, its licence and the begin of
    its sha256.

    \b
      rsa-data models
      rsa-data models fetch clip-rn50 rsa-depth-anything
      rsa-data models check yolox-nano
    """
    if ctx.invoked_subcommand is None:
        rows = [entry.row for entry in listing.entries()]
        for line in table_lines(["model", "kind", "file", "licence", "sha256"], rows):
            click.echo(line)


@models.command()
@click.argument("names", nargs=-1, required=True)
def fetch(names: tuple[str, ...]) -> None:
    """Download models and check them, for use without a network later."""
    missing = 0
    for name, got in listing.fetch(names).items():
        missing += isinstance(got, RsaDataError)
        click.echo(f"{name}: {got}", err=isinstance(got, RsaDataError))
    if missing:
        raise RsaDataError(f"{missing} of {len(names)} models could not be fetched")


@models.command()
@click.argument("names", nargs=-1)
@click.option(
    "--weights",
    multiple=True,
    callback=key_values,
    metavar="NAME=FILE",
    help="File of a model, instead of the download; may be repeated.",
)
@click.option("--out", type=FilePath(), help="JSON file of what was run.")
@click.option("--table", type=FilePath(), help="Markdown table of what was run.")
def check(
    names: tuple[str, ...], weights: dict[str, Any], out: Path | None, table: Path | None
) -> None:
    """Run models on two rendered scenes and check what they find."""

    def report(result: checking.Result) -> None:
        click.echo(f"{result.name}: {result.state}" + (f": {result.reason}" * bool(result.reason)))

    given = {name: Path(path) for name, path in weights.items()}
    for option, path in (("--out", out), ("--table", table)):
        if path is not None:
            check_output(path, option, identities(given.values()))
    found = checking.check(names or tuple(given), given, report)
    if out is not None:
        files.write(out, json.dumps(found, indent=2).encode())
    if table is not None:
        files.write(table, checking.table(found).encode())
    bad = [model["name"] for model in found["models"] if model["state"] != "ok"]
    if bad:
        raise RsaDataError(f"{len(bad)} of {len(found['models'])} models failed or are missing")
