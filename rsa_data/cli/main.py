"""The command line: one group, whose commands are loaded when they are called."""

import sys
import warnings
from importlib import import_module
from typing import Any

import click

from .. import registry
from ..common import own_code, pandas_later
from ..common.errors import unknown
from ..common.options import RenamedOption
from . import console, process
from .options import current_words

# Literal, so that `rsa-data --help` loads no command and a command loads its own module only.
# The commands of the row stages follow from `registry.STAGES`; here is their help in one line.
STAGE_HELP = {
    "detect": "Detect what each image shows, or import existing segments.",
    "captions": "Write captions of what each image shows.",
    "embed": "Turn captions into text embeddings.",
    "embed-images": "Turn images into embeddings.",
    "embed-objects": "List the objects of each image for heads that read them.",
    "embed-proposals": "Gather the detector's features of each image's objects.",
    "depth": "Run a relative-depth model, or read its files.",
}

# The other commands: NAME -> where the command is, and its help in one line.
COMMANDS = {
    "train-head": (
        "rsa_data.cli.heads:train_head",
        "Train a head that predicts scale and shift from a caption's embedding.",
    ),
    "evaluate": ("rsa_data.cli.studies:evaluate", "Measure a head on the test splits."),
    "robustness": (
        "rsa_data.cli.studies:robustness",
        "Measure a head with wrong or poor descriptions.",
    ),
    "compare": (
        "rsa_data.cli.studies:compare",
        "Train and measure heads on text, other inputs and controls.",
    ),
    "predict": ("rsa_data.cli.predict:predict", "Predict metric depth of photos or captions."),
    "import-head": (
        "rsa_data.cli.heads:import_head",
        "Turn a released RSA checkpoint (.pt) into a head of the work dir.",
    ),
    "export-head": (
        "rsa_data.cli.heads:export_head",
        "Write a head to take to another machine, with its model card.",
    ),
    "run": ("rsa_data.cli.tables:run", "Run a pipeline file: several stages with their options."),
    "plan": ("rsa_data.cli.planning:plan", "Estimate the time and disk space that a stage needs."),
    "retry-failed": ("rsa_data.cli.tables:retry_failed", "Process parts with failed rows again."),
    "status": ("rsa_data.cli.look:status", "Show the tables and heads of a work dir."),
    "verify": ("rsa_data.cli.look:verify", "Read every part again and check it."),
    "show": ("rsa_data.cli.look:show", "Draw one sample: segments, captions, depth, prediction."),
    "report": ("rsa_data.cli.report:report", "Write one HTML file that shows a work dir."),
    "play": ("rsa_data.cli.play:play", "Try a head in the browser."),
    "export": ("rsa_data.cli.export:export", "Write captions and features as a dataset."),
    "list": ("rsa_data.cli.names:list_names", "List the names that options take."),
    "models": (
        "rsa_data.cli.models:models",
        "Show, fetch and check models.",
    ),
    "demo": ("rsa_data.cli.demo:demo", "Run the whole chain on synthetic scenes."),
}


def names() -> list[str]:
    """Names of all commands, in the order data flows."""
    return [*registry.STAGES, *COMMANDS]


def load(name: str) -> click.Command:
    """The command of that name; imports its module."""
    command: click.Command
    if name in registry.STAGES:
        command = import_module("rsa_data.cli.tables").command(name)
    else:
        module, attribute = COMMANDS[name][0].split(":")
        command = getattr(import_module(module), attribute)
    if "pyarrow" in sys.modules:
        pandas_later.install()
    return command


def short_help(name: str) -> str:
    """What a command does, in one line."""
    if name in COMMANDS:
        return COMMANDS[name][1]
    return STAGE_HELP[name] if name in STAGE_HELP else load(name).get_short_help_str(limit=100)


class Group(click.Group):
    """Commands in the order data flows; a typo gets the nearest name; old option names work."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return names()

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        return load(name) if name in names() else None

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        for line in own_code.unusable():
            warnings.warn(line, stacklevel=2)
        own_code.allow(args)
        if args and args[0] not in names() and not args[0].startswith("-"):
            raise click.UsageError(str(unknown("command", args[0], names())))
        name, command, rest = super().resolve_command(ctx, args)
        return name, command, current_words(name or "", rest)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, short_help(name)) for name in names()])


@click.group(
    cls=Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
@click.version_option(package_name="rsa-data")
@click.option(
    "--debug",
    is_flag=True,
    help="Show the traceback of an unexpected error.",
    expose_value=False,
    callback=process.debug,
)
def cli() -> None:
    """Predict metric depth from relative depth and a caption.

    Each command reads tables from a work dir and writes the next one. Every command can be stopped
    at any time and run again. The whole chain on real data:

    \b
      rsa-data captions --dataset nyuv2
      rsa-data embed
      rsa-data depth --dataset nyuv2 --depth-model depth-anything-v2-small
      rsa-data train-head
      rsa-data evaluate --head head
    """


def _show_warnings_once() -> None:
    """Makes each warning a line on standard error, the same one only once."""
    shown = set()

    def show(message: Warning | str, *place: Any, **more: Any) -> None:
        if str(message) not in shown:
            shown.add(str(message))
            console.warn(str(message))

    warnings.simplefilter("always", RenamedOption)
    warnings.showwarning = show


def main() -> None:
    """The console script: exit 0 when all is done, 2 for a wrong call, 1 for a failure, 130 when
    interrupted."""
    process.run(_run)


def _run() -> None:
    with warnings.catch_warnings():
        _show_warnings_once()
        cli(standalone_mode=False)


if __name__ == "__main__":
    main()
