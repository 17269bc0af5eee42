"""Commands that make and use heads: train-head, evaluate, predict, import-head."""

from pathlib import Path
from typing import Any

import click

from ..common.options import call
from ..evaluation.evaluate import evaluate as evaluate_function
from ..heads.predict.predict import predict as predict_function
from ..heads.released import import_head as import_function
from ..heads.train.train_head import train_head as train_head_function
from ..store.tables import WorkDir
from . import console
from .options import click_options
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
    say_next(WorkDir(work), f"evaluate --head {options['name']}")


@click.command()
@work_option
@click_options(evaluate_function)
def evaluate(work: str, **options: Any) -> None:
    """Measure a head on the test splits.

    Oracles and constants are measured beside it.

    \b
      rsa-data evaluate --head nyu
    """
    result = call(evaluate_function, WorkDir(work), bar=console.bar, **options)
    click.echo(result.summary)
    say_next(
        WorkDir(work), f'predict --head {options["head"]} --caption "a small bathroom with a sink"'
    )


@click.command()
@work_option
@click_options(predict_function)
def predict(work: str, **options: Any) -> None:
    """Predict metric depth of photos or captions.

    \b
      rsa-data predict --head nyu --caption "a small bathroom with a sink"
      rsa-data predict --head nyu --image room.jpg --known 320,240,2.5 --out room.png
    """
    click.echo(call(predict_function, WorkDir(work), **options).summary)


@click.command("import-head")
@work_option
@click.argument("file", type=click.Path(path_type=Path))
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
    say_next(
        WorkDir(work), f"predict --head {Path(where).name} --encoder-weights CLIP --caption TEXT"
    )
