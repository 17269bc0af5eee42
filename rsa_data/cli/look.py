"""Commands that only look at a work dir: status, verify, show."""

from pathlib import Path

import click

from ..common.errors import RsaDataError
from ..common.ranges import Count
from ..runner import recompute as recomputing
from ..runner import status as state
from ..runner import verify as checks
from ..store.tables import WorkDir
from .options import FilePath, Number
from .shared import work_option


@click.command("status")
@work_option
def status(work: str) -> None:
    """Show the tables and heads of a work dir.

    For each table: parts, rows, failures, size, and whether it is out of date.

    \b
      rsa-data status
    """
    found = state.status(WorkDir(work))
    for line in found.lines:
        click.echo(line)
    for line in found.broken:
        click.echo(f"broken: {line}", err=True)
    if found.broken:
        raise RsaDataError(
            f"{len(found.broken)} of its files cannot be read; `rsa-data verify` names all damage"
        )


@click.command()
@work_option
@click.option(
    "--recompute",
    default=0,
    type=Number(Count),
    metavar="N",
    help="Also compute N random parts of each table again and compare them.",
)
def verify(work: str, recompute: int) -> None:
    """Read every part again and check it.

    \b
      rsa-data verify
      rsa-data verify --recompute 2
    """
    problems = checks.verify(WorkDir(work), click.echo)
    if recompute:
        problems += recomputing.recompute(WorkDir(work), recompute, click.echo)
    if problems:
        raise RsaDataError(
            f"{problems} problem{'' if problems == 1 else 's'} found. To make a bad part again, "
            "delete its receipt (WORK/DATASET/TABLE/_part-NNNNN.json) and run the command of its "
            "table again"
        )


@click.command()
@work_option
@click.argument("sample_id")
@click.option("--head", help="Head that predicts; by default one that was trained on the dataset.")
@click.option(
    "--out",
    type=FilePath(),
    default=Path("sample.png"),
    show_default=True,
    help="Picture file to write.",
)
def show(work: str, sample_id: str, head: str | None, out: Path) -> None:
    """Draw one sample: segments, captions, depth, prediction.

    \b
      rsa-data show nyuv2/test/bathroom/rgb_00045 --out bathroom.png
    """
    from ..views.pictures import sample

    for line in sample.draw(WorkDir(work), sample_id, head, out):
        click.echo(line)
    click.echo(f"picture: {out}")
