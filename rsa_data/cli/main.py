"""The command line: one group, whose commands are loaded when they are called."""

import signal
import sys
from importlib import import_module
from typing import Any

import click

from .. import registry
from ..common.errors import RsaDataError, unknown
from . import console

# Beside the commands of the row stages, which follow from `registry.STAGES`. Literal names, so that
# a command loads its own module only.
COMMANDS = {
    "train-head": "rsa_data.cli.heads:train_head",
    "evaluate": "rsa_data.cli.heads:evaluate",
    "robustness": "rsa_data.cli.studies:robustness",
    "compare": "rsa_data.cli.studies:compare",
    "predict": "rsa_data.cli.heads:predict",
    "import-head": "rsa_data.cli.heads:import_head",
    "run": "rsa_data.cli.tables:run",
    "plan": "rsa_data.cli.planning:plan",
    "retry-failed": "rsa_data.cli.tables:retry_failed",
    "status": "rsa_data.cli.look:status",
    "verify": "rsa_data.cli.look:verify",
    "show": "rsa_data.cli.look:show",
    "report": "rsa_data.cli.report:report",
    "play": "rsa_data.cli.play:play",
    "export": "rsa_data.cli.export:export",
    "list": "rsa_data.cli.look:list_names",
    "demo": "rsa_data.cli.demo:demo",
}


class Group(click.Group):
    """Commands in the order data flows; a typo gets the nearest name; errors set the status."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [*registry.STAGES, *COMMANDS]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name in registry.STAGES:
            made: click.Command = import_module("rsa_data.cli.tables").command(name)
            return made
        if name not in COMMANDS:
            return None
        module, attribute = COMMANDS[name].split(":")
        found: click.Command = getattr(import_module(module), attribute)
        return found

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        names = self.list_commands(ctx)
        if args and args[0] not in names and not args[0].startswith("-"):
            raise click.UsageError(str(unknown("command", args[0], names)))
        return super().resolve_command(ctx, args)


@click.group(
    cls=Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
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


if __name__ == "__main__":
    main()
