"""Tables of names that a user can choose: this package's own, installed ones, `module:attribute`.

An installed package adds names by entry points of the group `rsa_data.KIND`, such as
`rsa_data.styles`. Code that is not installed is named as `module:attribute` where a name goes, see
own_code.py.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from typing import Any

from . import own_code
from .digests import read_sha256


@dataclass(frozen=True)
class Installed:
    """A name that an installed package adds. target : `module:attribute`."""

    target: str
    package: str
    version: str


class Entries(dict[str, str]):
    """NAME -> `module:attribute`; names of installed packages stand behind the package's own.

    group : the entry points `rsa_data.GROUP` of installed packages are names too.
    of : what an entry is, as `module:Class` each; none: something to call.
    """

    def __init__(self, group: str, own: dict[str, str], of: tuple[str, ...] = ()):
        super().__init__(own)
        self.group, self.of = group, of

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
        return own_code.typed(name) or default

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
            if own_code.REFERENCE.fullmatch(f"{name}:{attribute}") and own_code.is_there(name):
                return f"{name}:{attribute}", rest
        return name, argument

    def module(self, name: str) -> str | None:
        """The module of code that is not this package's; None for other names."""
        target = None if self.is_own(name) else self.get(name)
        return target.partition(":")[0] if target else None

    def source(self, name: str) -> dict[str, str] | None:
        """Where code that is not this package's comes from: module, version and sha256 of it.

        None for names of this package.
        """
        if self.is_own(name):
            return None
        entry = self.installed().get(name)
        target = entry.target if entry else own_code.typed(name) or name
        digest = read_sha256(own_code.source_file(target.partition(":")[0]))
        about = {"code": target, "code_sha256": digest}
        return about | ({"code_package": f"{entry.package} {entry.version}"} if entry else {})


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
