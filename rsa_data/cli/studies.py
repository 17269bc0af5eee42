"""Commands that measure heads: evaluate, robustness, compare."""

from typing import Any

import click

from ..common.options import call
from ..evaluation.compare import compare as compare_function
from ..evaluation.evaluate import evaluate as evaluate_function
from ..evaluation.robustness import robustness as robustness_function
from ..store.tables import WorkDir
from . import console
from .following import code_of_head, use
from .options import click_options
from .shared import say_next, work_option


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
    place, name = WorkDir(work), options["head"]
    say_next(place, use(place, name), code_of_head(place, name))


@click.command()
@work_option
@click_options(robustness_function)
def robustness(work: str, **options: Any) -> None:
    """Measure a head with wrong or poor descriptions.

    \b
      rsa-data robustness --head nyu
    """
    click.echo(call(robustness_function, WorkDir(work), bar=console.bar, **options).summary)


@click.command()
@work_option
@click_options(compare_function)
def compare(work: str, **options: Any) -> None:
    """Train and measure heads on text, other inputs and controls.

    \b
      rsa-data compare --work demo
    """
    click.echo(call(compare_function, WorkDir(work), bar=console.bar, **options).summary)
