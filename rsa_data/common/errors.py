"""The errors that a user of rsa-data meets, and the exit status that each one means."""

import difflib
from collections.abc import Iterable


class RsaDataError(Exception):
    """Something went wrong that the message explains: where, expected, found, way out."""

    exit_code = 1


class UsageError(RsaDataError):
    """The call itself is wrong: unknown name, bad option, options that do not go together."""

    exit_code = 2


class RowError(RsaDataError):
    """One row cannot be processed and never will be with this input: it is quarantined.

    The message becomes the row's `error`, so it names files relative to the dataset's root and
    carries no hosts, times or absolute paths.
    """


class TransientError(RsaDataError):
    """A failure that may pass (I/O error, 503): the part stays undone and can be run again."""


def unknown(kind: str, name: str, choices: Iterable[str]) -> UsageError:
    """The error for a name that is not among `choices`, with the nearest one if any is near."""
    choices = sorted(choices)
    near = difflib.get_close_matches(name, choices, 1)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    return UsageError(f"unknown {kind} {name!r}.{hint} Choices: {', '.join(choices)}")
