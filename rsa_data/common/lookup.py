"""From a name to what it stands for: entries of the registry's tables, found and loaded."""

import inspect
from importlib import import_module
from typing import Any

from . import own_code
from .entries import Entries
from .errors import RsaDataError, UsageError, unknown
from .extras import extras


def resolve(kind: str, table: dict[str, str], name: str) -> Any:
    """The object that `name` stands for in one of the tables above.

    Raises UsageError when the name is unknown (with the choices and the nearest one), and
    RsaDataError with the pip line when a package that it needs is not installed. Code that is not
    this package's is held against what the table's entries are.
    """
    check(kind, table, name)
    if isinstance(table, Entries) and not table.is_own(name):
        return own_code.load(kind, name, table[name], table.of)
    module, attribute = table[name].split(":")
    with extras(f"{kind} {name!r}"):
        return getattr(import_module(module), attribute)


def check(kind: str, table: dict[str, str], name: str) -> None:
    """Raises UsageError for a name that is not in the table, with the choices and the nearest."""
    if name not in table:
        raise own_code.not_allowed(kind, name) or UsageError(
            f"{unknown(kind, name, table)}{own_code.not_found(name)}"
        )


def build(kind: str, table: dict[str, str], choice: str) -> Any:
    """What `NAME` or `NAME:ARGUMENT` stands for: the entry called, with its argument.

    Raises UsageError when the argument is missing or not wanted, and as `resolve` does.
    """
    name, colon, argument = choice.partition(":")
    if isinstance(table, Entries):
        name, argument = table.split(choice)
        colon = ":" if len(choice) > len(name) else ""
    make = resolve(kind, table, name)
    takes = bool(inspect.signature(make).parameters)
    if takes != bool(colon):
        expected = f"{name}:NAME_OR_DIR" if takes else name
        raise UsageError(f"{kind}: expected {expected}, found {choice!r}")
    return make(argument) if takes else make()


def described(table: dict[str, str]) -> list[tuple[str, str]]:
    """(name, what its model card says or the first line of its documentation) of every entry.

    Entries of installed packages name their package; a broken one shows its error.
    """
    installed = table.installed() if isinstance(table, Entries) else {}
    found = []
    for name in sorted(table):
        of = f" ({installed[name].package} {installed[name].version})" if name in installed else ""
        found.append((name, _first_line(name, table) + of))
    return found


def _first_line(name: str, table: dict[str, str]) -> str:
    from . import cards, source_docs

    if told := cards.about(name):
        return told
    own = not isinstance(table, Entries) or table.is_own(name)
    text = source_docs.doc(table[name]) if own else None
    if text is None:
        try:
            text = resolve("entry", table, name).__doc__ or ""
        except RsaDataError as error:
            return str(error)
    return text.strip().partition("\n")[0]
