"""Options and words that several commands share."""

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import click

from .. import registry
from ..common import units
from ..common.ranges import AtOnce
from ..datasets.roots import open_root
from ..runner import limits
from ..runner.chains import RunOptions
from ..runner.engines.pool import EngineOptions
from ..runner.plan import Estimate
from ..runner.plan import lines as plan_lines
from ..runner.runs import Summary
from ..store.tables import WorkDir
from . import console
from .following import with_code
from .options import Number

Command = TypeVar("Command", bound=Callable[..., Any])


def part_range(ctx: click.Context, param: click.Parameter, value: str | None) -> Any:
    """`0:8` as (0, 8); a usage error for anything else."""
    if value is None:
        return None
    first, colon, last = value.partition(":")
    numbers = [int(t) for t in (first, last) if t.isascii() and t.isdigit() and len(t) < 19]
    if not colon or len(numbers) != 2 or numbers[0] >= numbers[1]:
        raise click.BadParameter(f"expected FIRST:LAST, last excluded, as in 0:8; found {value!r}")
    return numbers[0], numbers[1]


# Set in the context's meta while `rsa-data plan` runs another command.
PLANNING = "rsa_data.planning"

_ENGINE = ("engine", "workers", "memory", "ray_address")
_HOW = ("split", "part_range", "start_over", "max_failures")


def max_failures(ctx: click.Context, param: click.Parameter, value: str) -> float | int:
    """A count or a share of rows; see `limits.parse_failures`."""
    return limits.parse_failures(value)


def memory_limit(ctx: click.Context, param: click.Parameter, value: str | None) -> int | None:
    """Bytes of a size such as 4GB, or None."""
    return None if value is None else units.parse_size(value, "--memory-limit")


def key_values(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> Any:
    """{name: value} of repeated NAME=VALUE; a usage error for anything else."""
    pairs = [item.partition("=") for item in value]
    for key, equals, _ in pairs:
        if not equals:
            raise click.BadParameter(f"expected NAME=VALUE; found {key!r}")
    return {key: text for key, _, text in pairs}


def root_of(ctx: click.Context, param: click.Parameter, value: str | None) -> Path | None:
    """A folder, or what reads like one; see `roots.open_root`."""
    if value == "":
        raise click.BadParameter("expected a place; found nothing")
    return None if value is None else open_root(value)


def work_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """--work, as every command has it."""
    return click.option(
        "--work",
        default="work",
        show_default=True,
        help="Work dir: folder of all tables and heads.",
    )(command)


def running(command: Callable[..., Any]) -> Callable[..., Any]:
    """--work and how to run: collects the options into `work: WorkDir` and `how: RunOptions`."""

    @functools.wraps(command)
    def wrapped(work: str, **given: Any) -> Any:
        engine = EngineOptions(**{n: given.pop(n) for n in _ENGINE})
        how = RunOptions(
            bar=console.bar, report=report, engine=engine, **{n: given.pop(n) for n in _HOW}
        )
        if click.get_current_context().meta.get(PLANNING):
            how = replace(
                how, plan=functools.partial(report_plan, engine.workers), start_over=False
            )
        return command(work=WorkDir(work), how=how, **given)

    for option in (
        click.option(
            "--start-over", is_flag=True, help="Delete the table first and make it again."
        ),
        click.option(
            "--max-failures",
            callback=max_failures,
            default="90%",
            show_default=True,
            metavar="N|SHARE%",
            help="Stop when more rows than this fail.",
        ),
        click.option(
            "--memory-limit",
            "memory",
            callback=memory_limit,
            metavar="SIZE",
            help="Stop a worker that uses more memory than this, such as 4GB.",
        ),
        click.option(
            "--ray-address",
            metavar="ADDRESS",
            help="Address of a Ray cluster, such as auto; by default Ray runs on this machine.",
        ),
        click.option(
            "--engine",
            type=click.Choice(list(registry.ENGINES)),
            default="local",
            show_default=True,
            help="Engine that runs the workers.",
        ),
        click.option(
            "--workers",
            default=1,
            type=Number(AtOnce),
            show_default=True,
            help="Number of worker processes.",
        ),
        click.option(
            "--part-range", callback=part_range, metavar="A:B", help="Process only parts A to B-1."
        ),
        click.option("--split", help="Process only this split, such as train or test."),
    ):
        wrapped = option(wrapped)
    return work_option(wrapped)


def one_dataset(command: Callable[..., Any]) -> Callable[..., Any]:
    """--dataset, --root and --dataset-option of the commands that may index."""
    for option in (
        click.option(
            "--dataset-option",
            "given",
            multiple=True,
            callback=key_values,
            metavar="NAME=VALUE",
            help="Option of the dataset, such as depth_unit=mm; see `rsa-data list datasets`.",
        ),
        click.option(
            "--root",
            callback=root_of,
            metavar="PLACE",
            help="Where the dataset's files are: a folder, s3://BUCKET/PREFIX, gs://, az:// or "
            "https://HOST/PATH.",
        ),
        click.option(
            "--dataset",
            required=True,
            help="Name of a dataset, or folder:NAME for your own images.",
        ),
    ):
        command = option(command)
    return command


def report(stage: str, dataset: str, summary: Summary) -> None:
    """Prints a stage's summary."""
    for line in console.summary_lines(stage, dataset, summary):
        click.echo(line)


def report_plan(workers: int, stage: str, dataset: str, estimate: Estimate) -> None:
    """Prints a stage's estimate."""
    for line in plan_lines(stage, dataset, estimate, workers):
        click.echo(line)


def say_next(work: WorkDir, command: str, code: list[str]) -> None:
    """Prints the next command to type, with --work where it is not the default.

    code : `module:attribute` of what it needs that is not this package's.
    """
    click.echo(f"next: {with_code(f'rsa-data {command}{work.option}', code)}")
