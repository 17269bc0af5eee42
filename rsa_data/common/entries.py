"""Tables of names that a user can choose: this package's own, installed ones, `module:attribute`.

An installed package adds names by entry points of the group `rsa_data.KIND`, such as
`rsa_data.styles`. Code that is not installed is named as `module:attribute` where a name goes.
Such code is imported only if the user named it: on the command line, in a pipeline file, or in the
environment variable RSA_DATA_CODE. A name that stands in a file of a work dir, a head or a model
card does not import anything.
"""

import hashlib
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib import import_module, metadata, util
from pathlib import Path
from typing import Any

from .errors import RsaDataError, UsageError

# Names in the form module:attribute that may be imported, separated by commas.
CODE = "RSA_DATA_CODE"
_REFERENCE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


@dataclass(frozen=True)
class Installed:
    """A name that an installed package adds. target : `module:attribute`."""

    target: str
    package: str
    version: str


class Entries(dict[str, str]):
    """NAME -> `module:attribute`; names of installed packages stand behind the package's own.

    group : the entry points `rsa_data.GROUP` of installed packages are names too.
    """

    def __init__(self, group: str, own: dict[str, str]):
        super().__init__(own)
        self.group = group

    def installed(self) -> dict[str, Installed]:
        """Names that installed packages add, less those of this package."""
        found = _installed(f"rsa_data.{self.group}")
        return {name: entry for name, entry in found.items() if not self.is_own(name)}

    def is_own(self, name: str) -> bool:
        """Whether this package itself has the name."""
        return super().__contains__(name)

    def get(self, name: str, default: Any = None) -> Any:
        """The `module:attribute` that a name stands for."""
        if self.is_own(name):
            return super().__getitem__(name)
        if (entry := self.installed().get(name)) is not None:
            return entry.target
        return _typed(name) or default

    def __missing__(self, name: str) -> str:
        if (found := self.get(name)) is None:
            raise KeyError(name)
        return str(found)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self.get(name) is not None

    def __iter__(self) -> Iterator[str]:
        yield from super().__iter__()
        yield from self.installed()

    def split(self, choice: str) -> tuple[str, str]:
        """(name, argument) of `NAME`, `NAME:ARGUMENT`, `module:attribute[:ARGUMENT]`.

        A name that is known wins over a module of that name.
        """
        name, _, argument = choice.partition(":")
        if not self.is_own(name) and name not in self.installed():
            attribute, _, rest = argument.partition(":")
            if _REFERENCE.fullmatch(f"{name}:{attribute}") and _is_there(name):
                return f"{name}:{attribute}", rest
        return name, argument

    def source(self, name: str) -> dict[str, str] | None:
        """Where code that is not this package's comes from: module, version and sha256 of it.

        None for names of this package.
        """
        if self.is_own(name):
            return None
        entry = self.installed().get(name)
        target = entry.target if entry else _typed(name) or name
        about = {"code": target, "code_sha256": _module_sha256(target.partition(":")[0])}
        return about | ({"code_package": f"{entry.package} {entry.version}"} if entry else {})


def allow(words: Iterable[str]) -> None:
    """Lets `module:attribute` be imported where it is one of these words that the user gave.

    Words are arguments as they were typed (`NAME`, `--style=NAME`, `NAME:ARGUMENT`). Processes that
    are started later inherit it.
    """
    found = list(allowed())
    for word in words:
        match = re.match(rf"(?:--[\w-]+=)?({_REFERENCE.pattern})(?::|$)", word)
        if match and match[1] not in found:
            found.append(match[1])
    if found:
        os.environ[CODE] = ",".join(found)


def allowed() -> tuple[str, ...]:
    """The names in the form `module:attribute` that may be imported."""
    return tuple(name for name in os.environ.get(CODE, "").split(",") if name)


def load(kind: str, name: str, target: str) -> Any:
    """The object behind `module:attribute` of code that is not this package's.

    Raises RsaDataError, which names the module and what went wrong, when it cannot be imported.
    """
    module, _, attribute = target.partition(":")
    try:
        found: Any = import_module(module)
        for step in attribute.split("."):
            found = getattr(found, step)
    # Code of others may raise anything while it is imported.
    except Exception as error:
        raise RsaDataError(
            f"{kind} {name!r}: expected {attribute} in the module {module}; found "
            f"{type(error).__name__}: {error}"
        ) from error
    return found


def not_allowed(kind: str, name: str) -> UsageError | None:
    """The error for `module:attribute` that nobody typed; None where it is no such name.

    name : as typed, or as tables have it, module-attribute.
    """
    module, _, attribute = name.rpartition("-")
    if ":" not in name and _is_there(module):
        name = f"{module}:{attribute}"
    if not _REFERENCE.fullmatch(name) or name in allowed():
        return None
    return UsageError(
        f"{kind} {name!r} is code that a file names; it is imported only if you name it yourself: "
        f"in the option, or with {CODE}={name}"
    )


def _typed(name: str) -> str | None:
    """The `module:attribute` that a name stands for where the user typed it.

    name : the same, or module-attribute, as names of tables have it.
    """
    return next((word for word in allowed() if name in (word, word.replace(":", "-"))), None)


@cache
def _entry_points() -> Any:
    return metadata.entry_points()  # reads a file of every installed package


@cache
def _installed(group: str) -> dict[str, Installed]:
    found: dict[str, Installed] = {}
    for entry in _entry_points().select(group=group):
        package = entry.dist.name if entry.dist else "unknown"
        version = entry.dist.version if entry.dist else "unknown"
        found.setdefault(entry.name, Installed(entry.value, package, version))
    return found


def _is_there(module: str) -> bool:
    """Whether Python would find a module, or the package that it is in, without importing it."""
    top = module.partition(".")[0]
    try:
        return bool(top) and util.find_spec(top) is not None
    except (ImportError, ValueError):
        return False


def _module_sha256(module: str) -> str:
    try:
        spec = util.find_spec(module)
    except (ImportError, ValueError) as error:
        raise RsaDataError(f"module {module}: expected one that can be found: {error}") from error
    if spec is None or spec.origin is None or not Path(spec.origin).is_file():
        raise RsaDataError(f"module {module}: expected a file with its source; found none")
    return hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest()
