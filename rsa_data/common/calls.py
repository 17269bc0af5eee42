"""What the calls of the public Python API share: checks of arguments, and errors that name them."""

import functools
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar, cast

from .errors import RsaDataError, UsageError

Function = TypeVar("Function", bound=Callable[..., Any])

# Commands are left as they are typed; an option outside of one is an argument.
_COMMAND_OR_OPTION = re.compile(r"`[^`]*`|rsa-data [a-z][^;:\n]*|(?<![\w-])--([a-z][a-z-]*)")


def in_python(function: Function) -> Function:
    """Decorator: errors name arguments (`relative=`) where they name options (`--relative`)."""

    @functools.wraps(function)
    def wrapped(*args: Any, **given: Any) -> Any:
        try:
            return function(*args, **given)
        except RsaDataError as error:
            error.args = (_COMMAND_OR_OPTION.sub(_argument, str(error)), *error.args[1:])
            raise

    return cast(Function, wrapped)


def _argument(match: re.Match[str]) -> str:
    if match[1] is None:
        return match[0]
    heads = match.start() == 0 and match.string[match.end() :].startswith(":")
    return match[1].replace("-", "_") + ("" if heads else "=")


def texts(where: str, given: Any) -> list[str]:
    """A list of at least one text; raises UsageError for anything else, a single text too."""
    if isinstance(given, (str, bytes)):
        raise UsageError(f"{where}: expected a list of texts, found one text: {given!r:.80}")
    try:
        found = list(given)
    except TypeError:
        raise UsageError(f"{where}: expected a list of texts, found {_kind(given)}") from None
    if not found:
        raise UsageError(f"{where}: expected at least one text, found none")
    for place, value in enumerate(found):
        if not isinstance(value, str):
            raise UsageError(f"{where}: expected texts; found {_kind(value)} at place {place}")
    return [str(value) for value in found]


def text(where: str, given: Any) -> str:
    """One text; raises UsageError for anything else."""
    if not isinstance(given, str):
        raise UsageError(f"{where}: expected one text, found {_kind(given)}")
    return str(given)


def path(where: str, given: Any) -> Path | None:
    """A path of a text or a path, None for None; raises UsageError for anything else."""
    if given is None:
        return None
    if not isinstance(given, (str, os.PathLike)):
        raise UsageError(f"{where}: expected a path, found {_kind(given)}")
    return Path(given)


def whole(where: str, given: Any, least: int) -> int:
    """A whole number of at least `least`; raises UsageError for anything else."""
    if isinstance(given, bool) or not hasattr(given, "__index__") or int(given) < least:
        raise UsageError(
            f"{where}: expected a whole number of {least} or more, found {given!r:.80}"
        )
    return int(given)


def _kind(value: Any) -> str:
    shown = f" {value!r:.60}" if isinstance(value, (int, float, str, Sequence)) else ""
    return f"{type(value).__name__}{shown}"
