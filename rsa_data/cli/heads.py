"""Commands that make and use heads: train-head, import-head, export-head."""

import shlex
from pathlib import Path
from typing import Any

import click

from ..common.options import call
from ..heads.import_head import import_head as import_function
from ..heads.train.train_head import train_head as train_head_function
from ..heads.travel import export_head as export_function
from ..store.tables import WorkDir
from . import console
from .following import after_training, code_of_head, use, with_code
from .options import FilePath, click_options
from .shared import say_next, work_option


@click.command("train-head")
@work_option
@click_options(train_head_function)
def train_head(work: str, **options: Any) -> None:
    """Train a head that predicts scale and shift from a caption's embedding.

    \b
      rsa-data train-head --head mlp5 --name nyu
    """
    result = call(train_head_function, WorkDir(work), bar=console.bar, **options)
    click.echo(result.summary)
    place, name = WorkDir(work), options["name"]
    say_next(place, after_training(place, name), code_of_head(place, name))


@click.command("export-head")
@work_option
@click.argument("name")
@click.argument("place", type=FilePath())
def export_head(work: str, name: str, place: Path) -> None:
    """Write a head to take to another machine, with its model card.

    PLACE is a file NAME.safetensors, which holds everything, or a folder as the Hugging Face hub
    takes it.

    \b
      rsa-data export-head nyu nyu.safetensors
    """
    for path in export_function(WorkDir(work), name, place):
        click.echo(f"wrote {path}")
    at = shlex.quote(str(place))
    quoted = shlex.quote(name)
    command = use(WorkDir(work), name).replace(f"--head {quoted} ", f"--head {at} ")
    if command.startswith("predict"):
        click.echo(f"next: {with_code(f'rsa-data {command}', code_of_head(WorkDir(work), name))}")


@click.command("import-head")
@work_option
@click.argument("file", type=FilePath())
@click_options(import_function)
def import_head(work: str, file: Path, **options: Any) -> None:
    """Turn a released RSA checkpoint (.pt) into a head of the work dir.

    \b
      rsa-data import-head da_lanscale.pt --name released
    """
    where, description = call(import_function, WorkDir(work), file, **options)
    click.echo(f"head {where}: {description['architecture']['name']}")
    for name, measures in description["imported"]["measures"].items():
        numbers = "  ".join(f"{key} {value:.4f}" for key, value in measures.items())
        click.echo(f"  its own test measures, {name}: {numbers}")
    say_next(WorkDir(work), use(WorkDir(work), Path(where).name), [])
