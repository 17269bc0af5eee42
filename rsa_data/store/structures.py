"""What stands in a table's helper files: the description of the table, receipts, the manifest.

Each is defined here and nowhere else. `typed.parse` reads one, `encoding.to_json` prints it.
"""

from typing import Any, TypeVar

import msgspec

from ..common.forms import KINDS, found
from ..common.typed import Count

T = TypeVar("T", bound=msgspec.Struct)

Unset = msgspec.UnsetType
UNSET = msgspec.UNSET


class Description(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """_table.json: what made a table, as far as it can change the content.

    stage, stage_version : what wrote it. schema, schema_version : of its parts.
    options : of the stage, without those that say where or how fast. files : sha256 of model files,
    by name. inputs : names of the tables read. identity : what else the content follows from, such
    as the version of a wording. made_with : versions of the software, for information only.
    """

    stage: str
    schema: str
    stage_version: int = 1
    schema_version: int = 1
    options: dict[str, Any] = {}
    files: dict[str, str] = {}
    inputs: list[str] = []
    identity: dict[str, str] | Unset = UNSET
    made_with: dict[str, str] | Unset = UNSET

    def __post_init__(self) -> None:
        for name in self.inputs:
            _need("inputs", "a path that stays below", name)

    def identifying(self) -> "Description":
        """The same without what is for information only."""
        return msgspec.structs.replace(self, made_with=UNSET)


class Made(msgspec.Struct, kw_only=True, frozen=True):
    """What the maker of a part knows of it.

    ok, failed, skipped : units that came in, by how they ended. split : of the samples.
    inputs : digest of the input part, by table. fingerprint : of all that the part follows from.
    audit : what the stage measured of its own work. cpu : the type of the CPU, where a model's
    arithmetic decides the last digits of the content.
    """

    ok: Count
    failed: Count
    skipped: Count
    split: str = ""
    inputs: dict[str, str] = {}
    fingerprint: str = ""
    audit: dict[str, Any] | None = None
    cpu: str = ""

    @property
    def units(self) -> int:
        """What came into the part."""
        return self.ok + self.failed + self.skipped


class Receipt(Made, kw_only=True, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """_part-NNNNN.json: a part that is done.

    file, bytes, sha256 : of its data. digest : of its logical content, see schemas.digest.
    """

    part: Count
    rows: Count
    file: str
    bytes: Count
    sha256: str
    digest: str

    def __post_init__(self) -> None:
        _need("file", "a file's name", self.file)

    @property
    def made(self) -> Made:
        """The part's account alone."""
        return Made(**{name: getattr(self, name) for name in Made.__struct_fields__})


class Manifest(msgspec.Struct, kw_only=True, frozen=True):
    """_manifest.json: all receipts of a finished table, and their sums."""

    rows: Count
    bytes: Count
    ok: Count
    failed: Count
    skipped: Count
    parts: list[Receipt]


def _need(name: str, kind: str, value: str) -> None:
    if not KINDS[kind](value):
        raise ValueError(f"{name}: expected {kind}, found {found(value)}")
