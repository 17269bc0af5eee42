"""The process of a command: its exit status, its streams, and errors that nobody sees as traces."""

import io
import os
import sys
import traceback
from collections.abc import Callable
from typing import Any

import click

from ..common import own_code, terminal
from ..common.errors import RsaDataError
from . import signals

# Shows the traceback of an unexpected error, as `rsa-data --debug` does.
DEBUG = "RSA_DATA_DEBUG"


def run(command: Callable[[], Any]) -> None:
    """Calls a command and ends the process: with 0 when it returns, 2 for a wrong call, 1 for a
    failure, 130 when it was stopped."""
    _take_numbers()  # before anything else is opened, such as the pipe of the signals
    signals.install()
    _open_streams()
    try:
        status = command() or 0
        sys.stdout.flush()
    except BaseException as error:
        status = _status(error)
    _end(status)


def debug(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    """The option --debug."""
    if value:
        os.environ[DEBUG] = "1"  # so that worker processes have it too


def _status(error: BaseException) -> int:
    """The exit status that an error means; says on standard error what it is."""
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else 1
    if signals.received() or isinstance(error, (KeyboardInterrupt, click.Abort)):
        signals.say_stopped()
        return 130
    if isinstance(error, BrokenPipeError):
        return 1  # the reader of standard output has left, as `head` does
    if isinstance(error, RsaDataError):
        _say(f"Error: {error}")
        return error.exit_code
    if isinstance(error, click.ClickException):
        error.show()
        return error.exit_code
    if os.environ.get(DEBUG):
        _say("".join(traceback.format_exception(error)).rstrip())
    _say(f"Error: {_unexpected(error)}")
    return 1


def _unexpected(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return "out of memory. Finished parts are kept: run it again with fewer --workers"
    if isinstance(error, RecursionError):
        return "the input is nested too deeply"
    kind, what = type(error).__name__, " ".join(str(error).split())
    if isinstance(error, OSError):
        where = f"{error.filename!s:.500}: " if error.filename else ""
        return where + (error.strerror or what)
    shown = f"unexpected {kind}: {what}" if what else f"unexpected {kind}"
    whose = " or ".join(["rsa-data", *(f"the code {name}" for name in own_code.at_work())])
    return f"{shown:.500}. This is a fault of {whose}: `rsa-data --debug ...` shows the traceback"


def _say(line: str) -> None:
    try:
        sys.stderr.write(line + "\n")
        sys.stderr.flush()
    except (OSError, ValueError):
        pass  # nobody reads it any more


def _take_numbers() -> None:
    """Opens standard streams that are closed on nothing.

    The next file opened would get such a number, and what libraries print would go into it.
    Standard output is opened so that it cannot be written: what a command prints there is lost,
    which is an error.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDONLY if number == 1 else os.O_RDWR)


def _open_streams() -> None:
    """Makes the standard streams safe to write to.

    Characters that the encoding of a stream lacks are written as escapes, and so are those that a
    terminal would obey.
    """
    for name, stream in (("stdout", sys.stdout), ("stderr", sys.stderr)):
        if stream is None:
            number = 1 if name == "stdout" else 2
            setattr(sys, name, open(number, "w", encoding="utf-8", closefd=False))  # noqa: SIM115
    for name, kind in (("stdout", _Output), ("stderr", _Errors)):
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):
            kept: dict[str, Any] = {"encoding": stream.encoding, "errors": "backslashreplace"}
            kept["line_buffering"] = stream.line_buffering
            setattr(sys, name, kind(stream.detach(), **kept))


class _Output(io.TextIOWrapper):
    """Standard output, without what a terminal would obey; says when it cannot be written."""

    def write(self, text: str) -> int:
        return super().write(terminal.plain(text))

    def flush(self) -> None:
        try:
            super().flush()
        except BrokenPipeError:
            raise
        except OSError as error:
            raise RsaDataError(
                f"standard output cannot be written: {error.strerror or error}"
            ) from error


class _Errors(io.TextIOWrapper):
    """Standard error, without what a terminal would obey but a progress bar's own returns."""

    def write(self, text: str) -> int:
        bar = self.isatty() and text.startswith("\r")
        return super().write("\r" * bar + terminal.plain(text.strip("\r") if bar else text))


def _end(status: int) -> None:
    """Ends the process; what cannot be written any more is a failure, not a trace at exit."""
    try:
        sys.stdout.flush()
    except (OSError, ValueError, RsaDataError):
        status = status or 1
        # Python would try once more at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.exit(status)
