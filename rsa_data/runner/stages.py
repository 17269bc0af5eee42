"""The row stages of the registry, and a stage together with the options that a user chose."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import registry
from ..common import options as binding
from ..common.entries import Entries
from ..common.errors import UsageError
from ..store.table_names import check_name, plain_name
from .stage import GIVEN, Options, Stage


def names() -> list[str]:
    """Names of the row stages, in the order data flows."""
    return list(registry.STAGES)


def stage(name: str) -> Stage:
    """A row stage by its name; raises UsageError with the nearest name for an unknown one."""
    found = registry.resolve("stage", registry.STAGES, name)
    assert isinstance(found, Stage)
    return found


def known(name: str) -> Stage | None:
    """The row stage of that name, or None: tables of the index name another kind of stage."""
    return stage(name) if name in registry.STAGES else None


def maker(kind: str) -> Stage:
    """The first stage that makes tables KIND/..."""
    return next(found for found in map(stage, names()) if found.kind == kind)


@dataclass(frozen=True)
class ConfiguredStage:
    """A stage with the options that a user chose, all of them bound, and the label of its table.

    label : None for the default: the name of the style, source, encoder or model.

    Raises UsageError for options or a label that the stage refuses.
    """

    stage: Stage
    options: Options
    label: str | None = None

    def __post_init__(self) -> None:
        self.stage.check(**self.options)
        if self.label is not None:
            check_name("--label", self.label)

    def default_label(self, read: str | None) -> str:
        """The label of the table where none was given.

        read : label of the table that the stage reads, if it reads one.
        """
        if self.stage.selector is None:
            assert read is not None
            return read
        own = self.stage.label(**self.options)
        return (
            label_of(str(self.options[self.stage.selector]), self.stage.choices)
            if own is None
            else own
        )


def bind(name: str, given: Mapping[str, Any]) -> ConfiguredStage:
    """A stage with all of its options: given ones converted, the others at their default.

    given : options by name, and `label` if the table shall have a name of its own.

    Raises UsageError for unknown stages, options and values; see `options.bind`.
    """
    what = stage(name)
    for option in given:
        if option.replace("-", "_") in GIVEN:
            raise UsageError(f"{name}: {option} is not an option of this stage")
    own = {option: value for option, value in given.items() if option != "label"}
    label = given.get("label")
    if label is not None and not isinstance(label, str):
        raise UsageError(f"{name}: label: expected text, found {label!r}")
    return ConfiguredStage(what, binding.bind(_without_given(what.build), own, name), label)


def label_of(choice: str, choices: Entries | None = None) -> str:
    """`rsa-release` of `rsa-release:DIR`: the part of a choice that says what, not where.

    choices : the table of names that it comes from; `module:attribute` becomes module-attribute.

    The argument of `hf:NAME` and `files:DIR` (depth of some model) is what was chosen, so its last
    component stays, as `hf-NAME`.
    """
    name, argument = choice, ""
    if choices is not None:
        name, argument = choices.split(choice)
    else:
        name, _, argument = choice.partition(":")
    if ":" in name:
        return plain_name(name)
    return f"{name}-{Path(argument).name}" if argument and name in ("hf", "files") else name


def _without_given(function: Callable[..., Any]) -> Callable[..., Any]:
    """A stand-in with the same docstring whose parameters are the user's options alone."""
    parameters = [p for n, p in binding.parameters(function).items() if n not in GIVEN]

    def stand_in(**_: Any) -> None: ...

    stand_in.__doc__ = function.__doc__
    stand_in.old_names = getattr(function, "old_names", {})  # type: ignore[attr-defined]
    stand_in.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return stand_in
