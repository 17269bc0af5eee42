"""Click's options from a function's signature, and words of the command line by their old names."""

import typing
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from ..common import ranges
from ..common.errors import UsageError
from ..common.options import RENAMED, choices, flag, help_text, parameters
from . import console

Command = TypeVar("Command", bound=Callable[..., Any])


def click_options(
    function: Callable[..., Any], hidden: tuple[str, ...] = ()
) -> Callable[[Command], Command]:
    """Decorator that gives a command one option for each option of `function`.

    hidden : options of the function that are not the user's. An option that is not given is passed
    as the parameter's default, which `--help` shows.
    """

    def decorate(command: Command) -> Command:
        for name in reversed(parameters(function)):
            if name not in hidden:
                command = one_option(function, name)(command)
        return command

    return decorate


def one_option(function: Callable[..., Any], name: str) -> Callable[[Command], Command]:
    """Decorator that gives a command one of the options of `function`."""
    declared, extra = _option(name, parameters(function)[name], help_text(function, name))
    return click.option(declared, **extra)


def _option(name: str, parameter: Any, text: str) -> tuple[str, dict[str, Any]]:
    """What click.option is called with: the flag, and everything else."""
    annotated = next(k for k in choices(parameter.annotation) if k is not type(None))
    kind, _ = ranges.split(annotated)
    required = parameter.default is parameter.empty
    sentence = text[:1].upper() + text[1:] + ("." if text else "")
    extra: dict[str, Any] = {"help": sentence, "required": required}
    declared = flag(name)
    if not required:
        extra |= {"default": parameter.default}
        extra |= {"show_default": parameter.default is not None}
    if typing.get_origin(kind) is typing.Literal:
        extra |= {"type": click.Choice(typing.get_args(kind))}
    elif typing.get_origin(kind) in (list, tuple):
        extra |= {"multiple": True, "type": typing.get_args(kind)[0], "show_default": False}
    elif kind is bool:
        extra |= {"is_flag": True} if parameter.default is False else {}
        declared += "" if parameter.default is False else f"/--no-{name.replace('_', '-')}"
    elif kind is Path:
        extra |= {"type": FilePath()}
    else:
        extra |= {"type": Number(annotated) if kind in (int, float) else kind}
    return declared, extra


class FilePath(click.Path):
    """A path; an empty text, which would mean the current folder, is none."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("expected a path; found nothing", param, ctx)
        return super().convert(value, param, ctx)


class Number(click.ParamType[Any]):
    """A number with a range, of a type such as `ranges.Positive`."""

    def __init__(self, annotated: Any):
        self.kind, limits = ranges.split(annotated)
        self.limits = limits or ranges.ANY
        self.name = "integer" if self.kind is int else "float"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            return ranges.number(value, self.kind, self.limits)
        except UsageError as error:
            self.fail(str(error), param, ctx)


def current_words(command: str, words: Sequence[str]) -> list[str]:
    """The words of a command with old option names replaced, each with a warning; see RENAMED."""
    old_names = {flag(old): flag(new) for old, new in RENAMED.get(command, {}).items()}
    found: list[str] = []
    for place, word in enumerate(words):
        if word == "--":
            return [*found, *words[place:]]
        name, equals, value = word.partition("=")
        if name in old_names:
            new = old_names[name]
            if any(other.partition("=")[0] == new for other in words):
                raise click.UsageError(f"{new} is given twice, once by its old name {name}")
            console.warn(f"{name} is now {new}")
            word = new + equals + value
        found.append(word)
    return found
