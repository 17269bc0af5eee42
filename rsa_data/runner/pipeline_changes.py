"""What is changed in a pipeline file before it is checked: old names of options, and --set."""

from collections.abc import Callable
from typing import Any

from .. import registry
from ..common import options
from ..common.errors import UsageError
from . import stages


def rename(tables: dict[str, Any]) -> None:
    """Old names of options become today's, with a warning each, here and in [dataset.NAME]."""
    for name, table in tables.items():
        takes = _takes(name)
        if takes is None:
            continue
        if isinstance(table, dict):
            tables[name] = options.current(takes, table)
        elif isinstance(table, list):
            tables[name] = [
                options.current(takes, one) if isinstance(one, dict) else one for one in table
            ]
    datasets = tables.get("dataset")
    for entry in datasets.values() if isinstance(datasets, dict) else ():
        if isinstance(entry, dict) and "dataset" not in entry:
            rename(entry)


def change(raw: dict[str, Any], places: list[str], value: Any, where: str) -> None:
    """Puts a value of --set into the tables of a file: places are names, or numbers in [[NAME]].

    Raises UsageError for a place that is no table.
    """
    places = _renamed(places)
    place: Any = raw
    for before, name in zip(("", *places), places[:-1], strict=False):
        if isinstance(place, list):
            place = _one_of(place, name, where)
        else:
            place = _table(place, before, where).setdefault(name, {})
    if isinstance(place, list):
        first = ".".join([*places[:-1], "0", places[-1]])
        raise UsageError(
            f"{where}: expected which of the {len(place)} tables [[{places[-2]}]], counted from 0, "
            f"such as {first}"
        )
    _table(place, places[-2] if len(places) > 1 else "", where)[places[-1]] = value


def _table(place: Any, name: str, where: str) -> dict[str, Any]:
    if not isinstance(place, dict):
        raise UsageError(f"{where}: expected {name} to be a table, found {place!r}")
    return place


def _one_of(tables: list[Any], number: str, where: str) -> Any:
    if not number.isdecimal() or int(number) >= len(tables):
        raise UsageError(f"{where}: expected a number from 0 to {len(tables) - 1}, found {number}")
    return tables[int(number)]


def _takes(name: str) -> Callable[..., Any] | None:
    """The function whose options a table of that name holds, if it is one of a stage or a step."""
    if name in registry.STEPS:
        found: Callable[..., Any] = registry.resolve("step", registry.STEPS, name)
        return found
    return stages.stage(name).build if name in registry.STAGES else None


def _renamed(places: list[str]) -> list[str]:
    table = next((p for p in reversed(places[:-1]) if not p.isdecimal()), "")
    takes = _takes(table)
    return places if takes is None else [*places[:-1], *options.current(takes, {places[-1]: None})]
