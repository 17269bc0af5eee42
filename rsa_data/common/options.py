"""Options are keyword-only parameters: their names, types, defaults and help stand in one place.

The command line is made from a function's signature and docstring, and pipeline files bind to the
same signature, so that a typo fails in a second, before anything loads. Options that belong
together may stand in a frozen dataclass: its fields are options of the function that has it as a
parameter with a default, such as `brush: Brush = Brush()`.
"""

import dataclasses
import functools
import inspect
import re
import types
import typing
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from . import numbers, ranges
from .errors import UsageError, unknown

Function = TypeVar("Function", bound=Callable[..., Any])

# Options by the command or stage that takes them: the name until version 0.1 -> the name now. The
# old one is accepted, with a warning, on the command line, in pipeline files and from Python.
RENAMED: dict[str, dict[str, str]] = {
    "detect": {"source": "segments", "model": "segmenter_weights", "model_card": "card"},
    "embed": {"weights": "encoder_weights"},
    "embed-images": {"weights": "encoder_weights"},
    "embed-proposals": {"source": "segments"},
    "depth": {"weights": "depth_weights"},
    "robustness": {"weights": "encoder_weights"},
    "predict": {
        "segmenter": "segments",
        "segmenter_model": "segmenter_weights",
        "weights": "encoder_weights",
    },
    "play": {
        "segmenter": "segments",
        "segmenter_model": "segmenter_weights",
        "weights": "encoder_weights",
    },
}


class RenamedOption(FutureWarning):
    """An option was given by the name that it had one minor version ago."""


def flag(name: str) -> str:
    """`--segmenter-weights` for `segmenter_weights`."""
    return "--" + name.replace("_", "-")


def accepts_old_names(command: str) -> Callable[[Function], Function]:
    """Decorator: the function takes options by their old names too, those of RENAMED[command]."""

    def decorate(function: Function) -> Function:
        @functools.wraps(function)
        def wrapped(*args: Any, **given: Any) -> Any:
            return function(*args, **current(wrapped, given))

        wrapped.old_names = RENAMED[command]  # type: ignore[attr-defined]
        return typing.cast(Function, wrapped)

    return decorate


def current(
    function: Callable[..., Any], given: Mapping[str, Any], warn: bool = True
) -> dict[str, Any]:
    """Options by the names they have now.

    warn : emit RenamedOption for each old name; false for what an older version has stored.
    Raises UsageError when an option is given by both of its names.
    """
    old_names: Mapping[str, str] = getattr(function, "old_names", {})
    found = {}
    for name, value in given.items():
        name = name.replace("-", "_")
        new = old_names.get(name, name)
        if new in found:
            raise UsageError(f"{flag(new)} is given twice, once by its old name")
        if new != name and warn:
            warnings.warn(f"{flag(name)} is now {flag(new)}", RenamedOption, stacklevel=3)
        found[new] = value
    return found


def stored(function: Callable[..., Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """Options by the names that tables keep, which never change since fingerprints hold them."""
    old = {new: old for old, new in getattr(function, "old_names", {}).items()}
    return {old.get(name, name): value for name, value in options.items()}


def parameters(function: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """The options of a function: its keyword-only parameters, those of a group by their fields."""
    found: dict[str, inspect.Parameter] = {}
    for name, parameter in _keywords(function).items():
        if _is_group(parameter):
            found |= _fields(parameter.annotation)
        else:
            found[name] = parameter
    return found


def grouped(function: Callable[..., Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Keyword arguments for a call: options that belong to a group's dataclass gathered in it."""
    rest, arguments = dict(given), {}
    for name, parameter in _keywords(function).items():
        if _is_group(parameter) and name not in rest:
            fields = {n: rest.pop(n) for n in _fields(parameter.annotation) if n in rest}
            arguments[name] = parameter.annotation(**fields)
    return {**rest, **arguments}


def call(function: Callable[..., Any], *args: Any, **options: Any) -> Any:
    """Calls a function with its options flat, as `bind` and the command line give them.

    Raises UsageError for a number out of its range.
    """
    known = parameters(function)
    for name in options.keys() & known:
        for annotated in choices(known[name].annotation):
            kind, limits = ranges.split(annotated)
            if limits is not None and options[name] is not None:
                ranges.number(options[name], kind, limits, f"{name}: ")
    return function(*args, **grouped(function, options))


def _keywords(function: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    signature = inspect.signature(function, eval_str=True)
    return {n: p for n, p in signature.parameters.items() if p.kind is p.KEYWORD_ONLY}


def _is_group(parameter: inspect.Parameter) -> bool:
    # Without a default it is an argument like any other, such as the dataset of a builder.
    return dataclasses.is_dataclass(parameter.default) and dataclasses.is_dataclass(
        parameter.annotation
    )


def _fields(group: type) -> dict[str, inspect.Parameter]:
    return dict(inspect.signature(group, eval_str=True).parameters)


def bind(function: Callable[..., Any], given: Mapping[str, Any], where: str) -> dict[str, Any]:
    """All options of `function`, given ones converted to their type, the others at their default.

    Flat: `call` gathers those of groups. Raises UsageError for an unknown name (with the nearest),
    a value of another type, or a missing option that has no default; `where` begins the message.
    """
    known = parameters(function)
    given = current(function, given)
    for name in given:
        if name not in known:
            raise UsageError(f"{where}: {unknown('option', name, known)}")
    bound = {}
    for name, parameter in known.items():
        if name in given:
            bound[name] = _convert(given[name], parameter, f"{where}: {name}")
        elif parameter.default is parameter.empty:
            raise UsageError(f"{where}: the option {name} is missing: {help_text(function, name)}")
        else:
            bound[name] = parameter.default
    return bound


def choices(annotation: Any) -> tuple[Any, ...]:
    """The types of an annotation: (int, NoneType) for int | None, with their ranges where they
    have some; see `ranges.split`."""
    if isinstance(annotation, types.UnionType) or typing.get_origin(annotation) is typing.Union:
        return typing.get_args(annotation)
    return (annotation,)


def _convert(value: Any, parameter: inspect.Parameter, where: str) -> Any:
    kinds = choices(parameter.annotation)
    if value is None and type(None) in kinds:
        return None
    for annotated in kinds:
        kind, limits = ranges.split(annotated)
        if limits is not None:
            return ranges.number(value, kind, limits, f"{where}: ")
        if typing.get_origin(kind) is typing.Literal and value in typing.get_args(kind):
            return value
        if kind in (str, int, float, bool) and type(value) is kind:
            return value
        if kind is float and type(value) is int and abs(value) < 2**53:
            return float(value)
        if kind is Path and isinstance(value, (str, Path)):
            return Path(value)
        if typing.get_origin(kind) in (list, tuple) and isinstance(value, (list, tuple)):
            return tuple(value)
        if isinstance(value, str) and kind in (int, float):
            try:
                return numbers.whole(value) if kind is int else numbers.real(value)
            except ValueError:
                continue
        if isinstance(value, str) and kind is bool and value.lower() in ("true", "false"):
            return value.lower() == "true"
    names = " or ".join(_said(kind) for kind in kinds if kind is not type(None))
    raise UsageError(f"{where}: expected {names}, found {value!r}")


def _said(kind: Any) -> str:
    """A type as errors name it; of a Literal its values."""
    if typing.get_origin(kind) is typing.Literal:
        *others, last = map(str, typing.get_args(kind))
        return f"{', '.join(others)} or {last}" if others else last
    return str(getattr(kind, "__name__", kind))


def help_text(function: Callable[..., Any], name: str) -> str:
    """The first sentence of an option's description in the docstring of function or group."""
    groups = [p.annotation for p in _keywords(function).values() if _is_group(p)]
    for source in (function, *groups):
        doc = inspect.getdoc(source) or ""
        match = re.search(rf"^{name}\s*:\s*(.+(?:\n[ ]{{4,}}.+)*)", doc, re.MULTILINE)
        if match:
            text = " ".join(match[1].split())
            return re.split(r"(?<=[.;])\s", text)[0].rstrip(".;")
    return ""
