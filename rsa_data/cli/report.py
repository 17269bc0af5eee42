"""Commands for people's eyes: report."""

from typing import Any

import click

from ..common.options import call
from ..store.tables import WorkDir
from ..views.report.build import report as report_function
from . import console
from .options import click_options
from .shared import work_option


@click.command()
@work_option
@click_options(report_function)
def report(work: str, **options: Any) -> None:
    """Write one HTML file that shows a work dir.

    \b
      rsa-data report
    """
    click.echo(call(report_function, WorkDir(work), bar=console.bar, **options).summary)
