"""The command plan: what another command would take."""

import click

from ..common.errors import unknown
from ..runner import stages
from .shared import PLANNING


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("stage")
@click.argument("words", nargs=-1, type=click.UNPROCESSED)
@click.pass_context
def plan(ctx: click.Context, stage: str, words: tuple[str, ...]) -> None:
    """Table, hours and bytes that a stage with these options would take; runs none of it.

    Index and inputs must be there or be quick to make: samples are indexed, a few rows are tried.

    \b
      rsa-data plan embed --encoder minilm --workers 2
    """
    from .main import Group

    planned = [*stages.names(), "run"]
    if stage not in planned:
        raise unknown("stage", stage, planned)
    command = Group().get_command(ctx, stage)
    assert command is not None
    ctx.meta[PLANNING] = True
    command.main(args=list(words), prog_name=f"rsa-data {stage}", parent=ctx, standalone_mode=False)
