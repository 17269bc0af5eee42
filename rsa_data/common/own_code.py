"""Code that is not this package's: which of it may be imported, and how.

It is imported only if the user named it: on the command line, in a pipeline file, or in the
environment variable RSA_DATA_CODE. A name that stands in a file of a work dir, a head or a model
card does not import anything.
"""

import os
import re
from collections.abc import Iterable
from importlib import import_module, util
from pathlib import Path
from typing import Any

from .errors import RsaDataError, UsageError

# Names in the form module:attribute that may be imported, separated by commas.
CODE = "RSA_DATA_CODE"
REFERENCE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
# The same of what was typed or stands in a pipeline file: for processes that are started later.
_TYPED = "RSA_DATA_TYPED_CODE"
_loaded: set[str] = set()


def allow(words: Iterable[str]) -> None:
    """Lets `module:attribute` be imported where it is one of these words that the user gave.

    Words are arguments as they were typed (`NAME`, `--style=NAME`, `NAME:ARGUMENT`). Processes that
    are started later inherit it.
    """
    found = list(_names(_TYPED))
    for word in words:
        match = re.match(rf"(?:--[\w-]+=)?({REFERENCE.pattern})(?::|$)", word)
        if match and match[1] not in found:
            found.append(match[1])
    if found:
        os.environ[_TYPED] = ",".join(found)


def allowed() -> tuple[str, ...]:
    """The names in the form `module:attribute` that may be imported."""
    return tuple(dict.fromkeys([*_names(CODE), *_names(_TYPED)]))


def at_work() -> tuple[str, ...]:
    """What RSA_DATA_CODE names, and what else this process has imported."""
    return tuple(dict.fromkeys([*named(), *sorted(_loaded)]))


def named() -> tuple[str, ...]:
    """Those that RSA_DATA_CODE names."""
    return _names(CODE)


def _names(variable: str) -> tuple[str, ...]:
    return tuple(name for name in os.environ.get(variable, "").split(",") if name)


def unusable() -> list[str]:
    """What is wrong with the names in the environment, a sentence each."""
    said = []
    for name in named():
        if not REFERENCE.fullmatch(name):
            said.append(f"{CODE}: expected module:attribute, separated by commas; found {name!r}")
        elif not is_there(name.partition(":")[0]):
            said.append(f"{CODE}: {_not_found(name)}")
    return said


def not_found(name: str) -> str:
    """A sentence to add to the error on an unknown name that may be that of a module, or ""."""
    words = (word for word in allowed() if word.partition(":")[0] == name)
    return "".join(f". If it is code of your own: {_not_found(word)}" for word in words)


def _not_found(word: str) -> str:
    path = os.environ.get("PYTHONPATH") or "not set"
    return (
        f"{word}: Python finds no module {word.partition(':')[0]}; put its folder on PYTHONPATH "
        f"(now {path})"
    )


def load(kind: str, name: str, target: str, of: tuple[str, ...] = ()) -> Any:
    """The object behind `module:attribute` of code that is not this package's.

    of : see `Entries`. Raises RsaDataError, which names the module and what went wrong, when it
    cannot be imported; UsageError when it is something else.
    """
    module, _, attribute = target.partition(":")
    _loaded.add(target)
    try:
        found: Any = import_module(module)
        for step in attribute.split("."):
            found = getattr(found, step)
    # Code of others may raise anything while it is imported.
    except Exception as error:
        way_out = "" if is_there(module) else f". {_not_found(target)}"
        raise RsaDataError(
            f"{kind} {name!r}: expected {attribute} in the module {module}; found "
            f"{type(error).__name__}: {error}{way_out}"
        ) from error
    if not (any(_is(found, form) for form in of) if of else callable(found)):
        wanted = of[0].partition(":")[2] if of else "function or class"
        what = found.__name__ if isinstance(found, type) else type(found).__name__
        raise UsageError(
            f"{kind} {name!r}: expected {_a(wanted)}; found {_a(what)}. docs/extending.md shows "
            f"what {_a(kind)} is"
        )
    return found


def _is(found: Any, form: str) -> bool:
    """Whether an object is of a class, or a class below it; form : `module:Class`."""
    module, _, name = form.partition(":")
    wanted = getattr(import_module(module), name)
    return isinstance(found, wanted) or (isinstance(found, type) and issubclass(found, wanted))


def _a(noun: str) -> str:
    return f"{'an' if noun[:1].lower() in 'aeiou' else 'a'} {noun}"


def not_allowed(kind: str, name: str) -> UsageError | None:
    """The error for `module:attribute` that nobody typed; None where it is no such name.

    name : as typed, or as tables have it, module-attribute.
    """
    module, _, attribute = name.rpartition("-")
    if ":" not in name and is_there(module):
        name = f"{module}:{attribute}"
    if not REFERENCE.fullmatch(name) or name in allowed():
        return None
    return UsageError(
        f"{kind} {name!r} is code that a file names; it is imported only if you name it yourself: "
        f"in the option, or with {CODE}={name}"
    )


def typed(name: str) -> str | None:
    """The `module:attribute` that a name stands for where the user typed it.

    name : the same, or module-attribute, as names of tables have it.
    """
    return next((word for word in allowed() if name in (word, word.replace(":", "-"))), None)


def is_there(module: str) -> bool:
    """Whether Python would find a module, or the package that it is in, without importing it."""
    top = module.partition(".")[0]
    try:
        return bool(top) and util.find_spec(top) is not None
    except (ImportError, ValueError):
        return False


def has_module(reference: str) -> bool:
    """Whether Python would find the module of `module:attribute`, without importing it."""
    return bool(REFERENCE.fullmatch(reference)) and is_there(reference.partition(":")[0])


def source_file(module: str) -> Path:
    """The file with a module's source; raises RsaDataError where there is none."""
    try:
        spec = util.find_spec(module)
    except (ImportError, ValueError) as error:
        raise RsaDataError(f"module {module}: expected one that can be found: {error}") from error
    if spec is None or spec.origin is None or not Path(spec.origin).is_file():
        raise RsaDataError(f"module {module}: expected a file with its source; found none")
    return Path(spec.origin)
