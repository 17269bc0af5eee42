"""The command plan: what another command would take."""

import click

from ..common.errors import unknown
from ..runner import stages
from .options import current_words
from .shared import PLANNING


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("stage")
@click.argument("words", nargs=-1, type=click.UNPROCESSED)
@click.pass_context
def plan(ctx: click.Context, stage: str, words: tuple[str, ...]) -> None:
    """Estimate the time and disk space that a stage needs.

    STAGE is a command such as embed, followed by its own options. The samples are indexed and a few
    rows are tried; nothing else is written.

    \b
      rsa-data plan embed --encoder minilm --workers 2
    """
    from .main import load

    planned = [*stages.names(), "run"]
    if stage not in planned:
        raise unknown("stage", stage, planned)
    command = load(stage)
    ctx.meta[PLANNING] = True
    command.main(
        args=current_words(stage, words),
        prog_name=f"rsa-data {stage}",
        parent=ctx,
        standalone_mode=False,
    )
