"""Commands that make tables: one for each row stage, run, retry-failed."""

from pathlib import Path
from typing import Any

import click

from ..common.options import parameters
from ..common.ranges import Positive
from ..runner import chains, pipeline_files, retry, stages
from ..runner.chains import RunOptions
from ..runner.stage import GIVEN, Stage
from ..runner.stages import ConfiguredStage
from ..store.tables import WorkDir
from . import following
from .options import Number, click_options, one_option
from .shared import key_values, one_dataset, running, say_next


def command(name: str) -> click.Command:
    """The command of a row stage, made from what the stage declares."""
    stage = stages.stage(name)
    call = _over_one(stage) if stage.begins else _over_all(stage)
    call = click_options(stage.build, hidden=GIVEN)(call)
    if stage.reads is not None:
        call = click.option(f"--{stage.reads.option}", "wanted", **_reads_help(stage))(call)
        for name in _files_of_first(stage):
            call = one_option(stages.maker(stage.reads.kind).build, name)(call)
    if stage.schema == "segments":
        call = click.option(
            "--preview",
            metavar="N",
            type=Number(Positive),
            help="Draw N images with their segments to a PNG file.",
        )(call)
    call = click.option(
        "--label", help=f"Name of the table; by default that of its {_named_after(stage)}."
    )(call)
    if stage.begins:
        call = one_dataset(call)
    else:
        call = click.option(
            "--dataset",
            "datasets",
            multiple=True,
            help="Process only this dataset; may be repeated.",
        )(call)
    return click.command(name, help=stage.help)(running(call))


def _files_of_first(stage: Stage) -> list[str]:
    """Options that name files of the stage which runs first, such as the segmenter's weights."""
    if stage.reads is None or not stage.reads.made_first:
        return []
    first = stages.maker(stage.reads.kind)
    known = parameters(first.build)
    return [name for name in first.local if known[name].annotation == Path | None]


def _named_after(stage: Stage) -> str:
    return (stage.selector or f"{stage.reads.kind if stage.reads else ''}").replace("_", " ")


def _reads_help(stage: Stage) -> dict[str, Any]:
    assert stage.reads is not None
    kind = stage.reads.kind
    if not stage.reads.made_first:
        return {"metavar": "LABEL", "help": f"Which {kind} to read, when there are several."}
    return {
        "metavar": "SOURCE",
        "help": f"Which {kind} to read: a label, or a source of {stages.maker(kind).name}.",
    }


def _over_one(stage: Stage) -> Any:
    def call(
        work: WorkDir,
        how: RunOptions,
        dataset: str,
        root: Path | None,
        given: dict[str, str],
        label: str | None,
        wanted: str | None = None,
        preview: int | None = None,
        **options: Any,
    ) -> None:
        files = {name: options.pop(name) for name in _files_of_first(stage)}
        files = {name: path for name, path in files.items() if path is not None}
        configured = ConfiguredStage(stage, options, label)
        first = chains.begin(work, configured, dataset, wanted, files)
        name = chains.samples(
            work, dataset, given, root=root, source=first or configured, say=click.echo
        )
        made = chains.chain(work, configured, name, how, root=root, wanted=wanted, first=first)
        if preview and how.plan is None:
            _draw(work, name, made.output, preview, root)
        _say_next(work, stage, name, made.output, how)

    return call


def _over_all(stage: Stage) -> Any:
    def call(
        work: WorkDir,
        how: RunOptions,
        datasets: tuple[str, ...],
        label: str | None,
        wanted: str | None = None,
        **options: Any,
    ) -> None:
        configured = ConfiguredStage(stage, options, label)
        names = chains.known_datasets(work, datasets)
        made = [chains.chain(work, configured, name, how, wanted=wanted) for name in names]
        _say_next(work, stage, names[0], made[0].output, how)

    return call


def _say_next(work: WorkDir, stage: Stage, dataset: str, output: str, how: RunOptions) -> None:
    if how.plan is None:
        folder = str(work.table(dataset, "samples")).removesuffix("samples")
        table = output.removeprefix(folder)
        command = following.after(work, stage, dataset, table)
        say_next(work, command, following.code_of_dataset(work, dataset))


def _draw(work: WorkDir, dataset: str, output: str, count: int, root: Path | None) -> None:
    from ..views.pictures.pictures import save
    from ..views.pictures.preview import preview

    label = output.rpartition("/")[2]
    sheet = Path(f"preview-{dataset}-{label}.png")
    save(preview(work, dataset, f"segments/{label}", count, root), sheet)
    click.echo(f"preview: {sheet}")


@click.command()
@click.argument("file", metavar="PIPELINE")
@running
@click.option(
    "--root",
    "roots",
    multiple=True,
    callback=key_values,
    metavar="DATASET=PLACE",
    help="Where the files of a dataset are; may be repeated.",
)
@click.option(
    "--set",
    "changes",
    multiple=True,
    callback=key_values,
    metavar="STAGE.OPTION=VALUE",
    help="Overrides an option of the pipeline file; may be repeated.",
)
def run(
    work: WorkDir, how: RunOptions, file: str, roots: dict[str, str], changes: dict[str, str]
) -> None:
    """Run a pipeline file: several stages with their options.

    \b
      rsa-data run 7scenes --root 7scenes=DIR
    """
    changes = {**{f"dataset.{name}.root": place for name, place in roots.items()}, **changes}
    pipeline = pipeline_files.load(Path(file), changes)
    click.echo(pipeline.doc)
    pipeline_files.run(work, pipeline, how, lambda step, result: click.echo(result.summary))


@click.command("retry-failed")
@running
@click.option(
    "--dataset", "wanted", multiple=True, help="Process only this dataset; may be repeated."
)
def retry_failed(work: WorkDir, how: RunOptions, wanted: tuple[str, ...]) -> None:
    """Process parts with failed rows again.

    Fix their input first. What was made from these parts is made again as well.

    \b
      rsa-data retry-failed
    """
    retry.retry_failed(work, chains.known_datasets(work, wanted), how)
