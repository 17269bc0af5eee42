"""Options and words that several commands share."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from .. import console
from ..parts import Work
from ..pipeline import How
from ..run import Summary


def part_range(ctx: click.Context, param: click.Parameter, value: str | None) -> Any:
    if value is None:
        return None
    first, colon, last = value.partition(":")
    if not colon or not first.isdigit() or not last.isdigit() or int(first) >= int(last):
        raise click.BadParameter(f"expected FIRST:LAST, last excluded, as in 0:8; found {value!r}")
    return int(first), int(last)


def key_values(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> Any:
    pairs = [item.partition("=") for item in value]
    for key, equals, _ in pairs:
        if not equals:
            raise click.BadParameter(f"expected NAME=VALUE; found {key!r}")
    return {key: text for key, _, text in pairs}


def work_option(command: Callable) -> Callable:
    """--work, as every command has it."""
    return click.option(
        "--work", default="work", show_default=True, help="Folder of all tables and heads."
    )(command)


def running(command: Callable) -> Callable:
    """--work and how to run: collects the options into `work: Work` and `how: How`."""

    @functools.wraps(command)
    def wrapped(work: str, **given: Any) -> Any:
        names = ("split", "part_range", "workers", "start_over")
        how = How(bar=console.bar, tell=tell, **{n: given.pop(n) for n in names if n in given})
        return command(work=Work(work), how=how, **given)

    for option in (
        click.option("--start-over", is_flag=True, help="Delete the table first, make it anew."),
        click.option("--workers", default=1, show_default=True, help="Processes side by side."),
        click.option(
            "--part-range", callback=part_range, metavar="A:B", help="Parts A to B-1."
        ),
        click.option("--split", help="Only this split, such as train or test."),
    ):
        wrapped = option(wrapped)
    return work_option(wrapped)


def one_dataset(command: Callable) -> Callable:
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
        click.option("--root", type=click.Path(path_type=Path), help="Where its files lie."),
        click.option(
            "--dataset",
            required=True,
            help="Name of a dataset, or folder:NAME for images of your own.",
        ),
    ):
        command = option(command)
    return command


def tell(stage: str, dataset: str, summary: Summary) -> None:
    for line in console.summary_lines(stage, dataset, summary):
        click.echo(line)


def say_next(work: Work, command: str) -> None:
    where = "" if work.store.location == "work" else f" --work {work.store.location}"
    click.echo(f"next: rsa-data {command}{where}")
