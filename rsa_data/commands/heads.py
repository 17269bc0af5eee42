"""Commands that make and use heads: train-head, evaluate."""

from typing import Any

import click

from .. import console
from ..evaluation.evaluate import evaluate as evaluate_function
from ..heads.training import train_head as train_head_function
from ..options import click_options
from ..parts import Work
from .shared import say_next, work_option


@click.command("train-head")
@work_option
@click_options(train_head_function)
def train_head(work: str, **options: Any) -> None:
    """Train the head that turns a caption's embedding into scale and shift.

    \b
      rsa-data train-head --head mlp5 --name nyu
    """
    result = train_head_function(Work(work), bar=console.bar, **options)
    click.echo(result.summary)
    say_next(Work(work), f"evaluate --head {options['name']}")


@click.command()
@work_option
@click_options(evaluate_function)
def evaluate(work: str, **options: Any) -> None:
    """Measure a head on the test splits, beside oracles and constants.

    \b
      rsa-data evaluate --head nyu
    """
    result = evaluate_function(Work(work), bar=console.bar, **options)
    click.echo(result.summary)
    say_next(
        Work(work), f'predict --head {options["head"]} --caption "a small bathroom with a sink"'
    )
