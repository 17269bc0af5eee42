"""The command line: parses, calls one library function, prints what came of it."""

import functools
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from . import console, jobs, pipeline, registry, stages, status
from .captions.write import build as captions_build
from .depth.measure import build as depth_build
from .encoders.embed import build as embed_build
from .errors import RsaDataError
from .evaluation.evaluate import evaluate as evaluate_heads
from .heads.training import train_head as train_head_function
from .options import click_options
from .parts import Work
from .pipeline import How
from .run import Summary
from .segmenters.detect import build as detect_build


class Group(click.Group):
    """Commands in the order data flows; a typo gets the nearest name; errors set the status."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if args and args[0] not in self.commands and not args[0].startswith("-"):
            raise click.UsageError(str(registry.unknown("command", args[0], self.commands)))
        return super().resolve_command(ctx, args)


@click.group(cls=Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="rsa-data")
def cli() -> None:
    """Captions, text embeddings and a light head that make relative depth metric.

    Each command reads tables from a work dir and writes the next one; all can be stopped at any
    time and run again. The chain on real data:

    \b
      rsa-data captions --dataset nyuv2
      rsa-data embed
      rsa-data depth --dataset nyuv2 --depth-model depth-anything-v2-small
      rsa-data train-head
      rsa-data evaluate --head head
    """


def main() -> None:
    """The console script: exit 0 when all is done, 2 for a wrong call, 1 for a failure, 130 when
    interrupted."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        sys.exit(cli(standalone_mode=False) or 0)
    except (KeyboardInterrupt, click.Abort):
        console.print_error(
            "\nStopped. Finished parts are kept: run the same command again to go on."
        )
        sys.exit(130)
    except RsaDataError as error:
        console.print_error(f"Error: {error}")
        sys.exit(error.exit_code)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)


def _range(ctx: click.Context, param: click.Parameter, value: str | None) -> Any:
    if value is None:
        return None
    first, colon, last = value.partition(":")
    if not colon or not first.isdigit() or not last.isdigit() or int(first) >= int(last):
        raise click.BadParameter(f"expected FIRST:LAST, last excluded, as in 0:8; found {value!r}")
    return int(first), int(last)


def _key_values(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> Any:
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
        how = How(bar=console.bar, tell=_tell, **{n: given.pop(n) for n in names if n in given})
        return command(work=Work(work), how=how, **given)

    for option in (
        click.option("--start-over", is_flag=True, help="Delete the table first, make it anew."),
        click.option("--workers", default=1, show_default=True, help="Processes side by side."),
        click.option("--part-range", callback=_range, metavar="A:B", help="Only parts A to B-1."),
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
            callback=_key_values,
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


def _tell(stage: str, dataset: str, summary: Summary) -> None:
    for line in console.summary_lines(stage, dataset, summary):
        click.echo(line)


def _next(work: Work, command: str) -> None:
    where = "" if work.store.location == "work" else f" --work {work.store.location}"
    click.echo(f"next: rsa-data {command}{where}")


@cli.command()
@running
@one_dataset
@click_options(detect_build, hidden=stages.GIVEN)
def detect(
    work: Work, how: How, dataset: str, root: Path | None, given: dict, **options: Any
) -> None:
    """Find what each image shows: a model's boxes or panoptic segments, or an import.

    \b
      rsa-data detect --dataset nyuv2 --source yolox-nano --model yolox_nano.onnx
    """
    name = pipeline.samples(work, dataset, given, root=root, source=options["source"])
    pipeline.stage(work, "detect", name, options, how, root=root)
    _next(work, f"captions --dataset {name}")


@cli.command()
@running
@one_dataset
@click.option("--segments", metavar="SOURCE", help="A segmenter, or an import as NAME:PLACE.")
@click_options(captions_build)
def captions(
    work: Work,
    how: How,
    dataset: str,
    root: Path | None,
    given: dict,
    segments: str | None,
    **options: Any,
) -> None:
    """Write the captions of a dataset, its index and segments first where they are missing.

    \b
      rsa-data captions --dataset nyuv2
      rsa-data captions --dataset nyuv2 --segments rsa-release:RSA/text
    """
    name = pipeline.samples(work, dataset, given, root=root, source=segments or "")
    pipeline.captions(work, name, options, how, segments=segments, detect={}, root=root)
    _next(work, f"embed --dataset {name}")


@cli.command()
@running
@click.option("--dataset", "wanted", multiple=True, help="Only this dataset; may be repeated.")
@click.option("--style", help="Which captions, when there are several.")
@click_options(embed_build)
def embed(work: Work, how: How, wanted: tuple[str, ...], style: str | None, **options: Any) -> None:
    """Turn the captions of every dataset into text embeddings, each distinct text once.

    \b
      rsa-data embed --encoder minilm
      rsa-data embed --encoder clip-rn50 --weights RN50.pt
    """
    for name in pipeline.known_datasets(work, wanted):
        pipeline.embed(work, name, options, how, style=style)
    _next(work, "depth --dataset NAME --depth-model MODEL, then: rsa-data train-head")


@cli.command()
@running
@one_dataset
@click_options(depth_build, hidden=stages.GIVEN)
def depth(
    work: Work, how: How, dataset: str, root: Path | None, given: dict, **options: Any
) -> None:
    """Relative depth of a model, or from files, beside the ground truth.

    \b
      rsa-data depth --dataset nyuv2 --depth-model depth-anything-v2-small
    """
    name = pipeline.samples(work, dataset, given, root=root)
    pipeline.stage(work, "depth", name, options, how, root=root)
    _next(work, "train-head")


@cli.command("train-head")
@work_option
@click_options(train_head_function)
def train_head(work: str, **options: Any) -> None:
    """Train the head that turns a caption's embedding into scale and shift.

    \b
      rsa-data train-head --head mlp5 --name nyu
    """
    result = train_head_function(Work(work), **options)
    click.echo(result.summary)
    _next(Work(work), f"evaluate --head {options['name']}")


@cli.command()
@work_option
@click_options(evaluate_heads)
def evaluate(work: str, **options: Any) -> None:
    """Measure a head on the test splits, beside oracles and constants.

    \b
      rsa-data evaluate --head nyu
    """
    result = evaluate_heads(Work(work), **options)
    click.echo(result.summary)
    _next(Work(work), f'predict --head {options["head"]} --caption "a small bathroom with a sink"')


@cli.command()
@click.argument("job")
@running
@click.option("--root", "roots", multiple=True, callback=_key_values, metavar="DATASET=DIR")
@click.option("--set", "changes", multiple=True, callback=_key_values, metavar="STAGE.OPTION=VALUE")
def run(work: Work, how: How, job: str, roots: dict, changes: dict) -> None:
    """Run a job file: a whole chain with its options.

    \b
      rsa-data run 7scenes --root 7scenes=DIR
    """
    changes = {**{f"dataset.{name}.root": place for name, place in roots.items()}, **changes}
    loaded = jobs.load(Path(job), changes)
    click.echo(loaded.get("doc", ""))
    jobs.run(work, loaded, how, lambda step, result: click.echo(result.summary))


@cli.command("status")
@work_option
def show_status(work: str) -> None:
    """What stands in a work dir: parts, rows, failures, sizes, and what is out of date.

    \b
      rsa-data status
    """
    for line in status.status(Work(work)):
        click.echo(line)


@cli.command()
@work_option
def verify(work: str) -> None:
    """Read every part again and hold it against its receipt.

    \b
      rsa-data verify
    """
    problems = status.verify(Work(work), click.echo)
    if problems:
        raise RsaDataError(f"{problems} problems found; delete a bad part's receipt to make it new")


@cli.command("retry-failed")
@running
@click.option("--dataset", "wanted", multiple=True, help="Only this dataset; may be repeated.")
def retry_failed(work: Work, how: How, wanted: tuple[str, ...]) -> None:
    """Do the parts with failed rows again, after the input has been mended.

    \b
      rsa-data retry-failed
    """
    pipeline.retry_failed(work, pipeline.known_datasets(work, wanted), how)


@cli.command("list")
@click.argument("what", required=False)
def list_names(what: str | None) -> None:
    """What can be chosen: datasets, segmenters, styles, encoders, depth models, heads, jobs.

    \b
      rsa-data list datasets
    """
    if what is not None and what not in _KINDS:
        raise registry.unknown("kind", what, _KINDS)
    for kind in [what] if what else _KINDS:
        click.echo(f"{kind}:")
        for name, doc in _KINDS[kind]():
            click.echo(f"  {name:28} {doc}")


_KINDS: dict[str, Callable[[], list[tuple[str, str]]]] = {
    "datasets": lambda: registry.described(registry.DATASETS),
    "segmenters": lambda: registry.described(registry.SEGMENTERS),
    "styles": lambda: registry.described(registry.STYLES),
    "encoders": lambda: registry.described(registry.ENCODERS),
    "depth-models": lambda: registry.described(registry.DEPTH_MODELS),
    "heads": lambda: registry.described(registry.HEADS),
    "jobs": jobs.described,
}


if __name__ == "__main__":
    main()
