"""Options are keyword-only parameters: their names, types, defaults and help stand in one place.

The command line is made from a function's signature and docstring, and job files bind to the same
signature, so that a typo fails in a second, before anything loads.
"""

import inspect
import re
import types
import typing
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click

from .errors import UsageError, unknown


def parameters(function: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """The keyword-only parameters of a function, annotations resolved."""
    signature = inspect.signature(function, eval_str=True)
    return {n: p for n, p in signature.parameters.items() if p.kind is p.KEYWORD_ONLY}


def bind(function: Callable[..., Any], given: Mapping[str, Any], where: str) -> dict[str, Any]:
    """All options of `function`, given ones converted to their type, the others at their default.

    Raises UsageError for an unknown name (with the nearest), a value of another type, or a
    missing option that has no default; `where` begins the message.
    """
    known = parameters(function)
    given = {name.replace("-", "_"): value for name, value in given.items()}
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


def _choices(annotation: Any) -> tuple[Any, ...]:
    """The types of an annotation: (int, NoneType) for int | None, literal values for Literal."""
    if isinstance(annotation, types.UnionType) or typing.get_origin(annotation) is typing.Union:
        return typing.get_args(annotation)
    return (annotation,)


def _convert(value: Any, parameter: inspect.Parameter, where: str) -> Any:
    kinds = _choices(parameter.annotation)
    if value is None and type(None) in kinds:
        return None
    for kind in kinds:
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
                return kind(value)
            except ValueError:
                continue
        if isinstance(value, str) and kind is bool and value.lower() in ("true", "false"):
            return value.lower() == "true"
    names = " or ".join(getattr(k, "__name__", str(k)) for k in kinds if k is not type(None))
    raise UsageError(f"{where}: expected {names}, found {value!r}")


def help_text(function: Callable[..., Any], name: str) -> str:
    """The first sentence of a parameter's description in the function's docstring."""
    doc = inspect.getdoc(function) or ""
    match = re.search(rf"^{name}\s*:\s*(.+(?:\n[ ]{{4,}}.+)*)", doc, re.MULTILINE)
    if not match:
        return ""
    text = " ".join(match[1].split())
    return re.split(r"(?<=[.;])\s", text)[0].rstrip(".;")


def click_options(function: Callable[..., Any], hidden: tuple[str, ...] = ()) -> Callable:
    """Decorator that gives a command one option for each keyword-only parameter of `function`.

    An option that is not given is passed as the parameter's default, which `--help` shows.
    """

    def decorate(command: Callable) -> Callable:
        for name, parameter in reversed(parameters(function).items()):
            if name in hidden:
                continue
            kinds = [k for k in _choices(parameter.annotation) if k is not type(None)]
            required = parameter.default is parameter.empty
            text = help_text(function, name)
            sentence = text[:1].upper() + text[1:] + ("." if text else "")
            extra: dict[str, Any] = {"help": sentence, "required": required}
            flag = "--" + name.replace("_", "-")
            if not required:
                extra |= {"default": parameter.default}
                extra |= {"show_default": parameter.default is not None}
            kind = kinds[0]
            if typing.get_origin(kind) is typing.Literal:
                extra |= {"type": click.Choice(typing.get_args(kind))}
            elif typing.get_origin(kind) in (list, tuple):
                extra |= {"multiple": True, "type": typing.get_args(kind)[0]}
            elif kind is bool:
                extra |= {"is_flag": True} if parameter.default is False else {}
                flag += "" if parameter.default is False else f"/--no-{name.replace('_', '-')}"
            elif kind is Path:
                extra |= {"type": click.Path(path_type=Path)}
            else:
                extra |= {"type": kind}
            command = click.option(flag, **extra)(command)
        return command

    return decorate
