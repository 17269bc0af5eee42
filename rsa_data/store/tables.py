"""Tables that appear part by part, are found whole or not at all.

A table is a folder with `table.json` (what made it, created once), files of data such as
`part-00007-1f0c2ab34d5e.parquet`, and receipts such as `part-00007.json`. A file of data is named
by its own sha256 and never changed; the receipt names it, and its appearance is the commit, on a
file system as on S3. So two runs at once cannot mix, and a part without a receipt is not done.
Nothing that depends on time, host or worker stands in any of them: the same work, the same bytes.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ..common import forms
from ..common.errors import RsaDataError, TransientError
from . import schemas as tables
from .encoding import differences, encoded, short
from .encoding import fingerprint as fingerprint
from .encoding import to_json as to_json
from .failpoints import failpoint
from .receipts import Receipts
from .stores import open_store

_FORM = {
    "stage": "text",
    "stage_version?": "a whole number",
    "schema": "text",
    "schema_version?": "a whole number",
    "options?": "an object",
    "files?": {"*": "text"},
}


class WorkDir:
    """A work dir: every table of every dataset, and the heads."""

    def __init__(self, location: str | Path):
        self.store = open_store(location)

    def datasets(self) -> list[str]:
        """Names of the datasets that have been indexed."""
        names = [name[:-1] for name in self.store.list("") if name.endswith("/")]
        return [name for name in names if self.table(name, "samples").exists()]

    def tables(self, dataset: str) -> list[str]:
        """Names of the tables of a dataset, such as samples and captions/occupancy."""
        found, folders = [], [""]
        while folders:
            folder = folders.pop()
            names = self.store.list(f"{dataset}/{folder}")
            if "table.json" in names:
                found.append(folder.rstrip("/"))
            folders += [folder + name for name in names if name.endswith("/")]
        return sorted(found)

    def table(self, dataset: str, name: str) -> "Table":
        """One table, whether it exists yet or not."""
        return Table(self, dataset, name)


class Table(Receipts):
    """The parts of one table."""

    def __init__(self, work: WorkDir, dataset: str, name: str):
        super().__init__(work.store, f"{dataset}/{name}")
        self.dataset, self.name = dataset, name

    def exists(self) -> bool:
        """Whether the table has been begun."""
        return self.store.size(f"{self.path}/table.json") is not None

    def description(self) -> dict[str, Any]:
        """table.json: stage, stage_version, schema, schema_version, options, files, inputs."""
        data = self.store.read(f"{self.path}/table.json")
        if data is None:
            raise RsaDataError(f"{self}: no such table. Tables there: {self._neighbours()}")
        try:
            found = forms.check(json.loads(data), _FORM, f"{self}: table.json")
            to_json(found)  # a lone surrogate, which JSON can spell, has no UTF-8
        except (ValueError, RecursionError) as error:
            raise RsaDataError(
                f"{self}: table.json: expected JSON, found {data!r:.60}. --start-over makes it anew"
            ) from error
        if self.dataset != "heads":  # whose inputs are those of several datasets
            form = {"inputs?": ["a path that stays below"]}
            forms.check(found, form, f"{self}: table.json")
        return found

    def _neighbours(self) -> str:
        work = WorkDir.__new__(WorkDir)
        work.store = self.store
        return ", ".join(work.tables(self.dataset)) or "none"

    def read(
        self,
        number: int,
        columns: list[str] | None = None,
        *,
        receipt: dict[str, Any] | None = None,
        check: bool = False,
    ) -> pa.Table:
        """One part. Raises RsaDataError when it is not done or not what its receipt says.

        receipt : of the part, when the caller has it: these bytes, even if another run has
            replaced the part since. check : also hold the sha256 of the file against it.
        """
        wanted = receipt or self.receipt(number)
        path = f"{self.path}/{wanted['file']}"
        size = self.store.size(path)
        if size is None and receipt is None and (newer := self.receipt(number)) != wanted:
            return self.read(number, columns, receipt=newer, check=check)
        if size != wanted["bytes"]:
            found = "no file" if size is None else f"{size} bytes"
            raise RsaDataError(
                f"{self}: part {number}: expected {wanted['bytes']} bytes, as its receipt says; "
                f"found {found}. Run `rsa-data verify`; delete the receipt to make it again."
            )
        try:
            with self.store.open(path) as file:
                if check:
                    found = hashlib.sha256(file.read_buffer()).hexdigest()
                    if found != wanted["sha256"]:
                        raise pa.ArrowInvalid(
                            f"expected sha256 {wanted['sha256'][:12]}..., found {found[:12]}..."
                        )
                    file.seek(0)
                return pq.read_table(file, columns=columns, use_threads=False)
        except (pa.ArrowException, OSError) as error:
            raise RsaDataError(
                f"{self}: part {number} cannot be read: {error}. Run `rsa-data verify`; delete its "
                "receipt to make it again."
            ) from error

    def bind(self, description: Mapping[str, Any]) -> None:
        """Begins the table, or checks that what made it is what would go on with it.

        Raises RsaDataError naming each difference. `made_with` is for information only.
        """
        self.store.sweep(self.path)
        self.store.create(f"{self.path}/table.json", to_json(description))
        there = self.description()
        different = [
            f"{where}: the table has {short(old)}, this run has {short(new)}"
            for where, old, new in differences(there, description)
            if not where.startswith("made_with")
        ]
        if different:
            raise RsaDataError(
                f"{self} was made with other options. " + "; ".join(different) + ". Use the same "
                "options, another --work, or --start-over to delete this table and make it anew."
            )

    def commit(
        self, number: int, table: pa.Table, receipt: Mapping[str, Any], *, redo: bool = False
    ) -> dict[str, Any]:
        """Writes a part, then its receipt: from then on the part is done.

        receipt : what the caller knows (ok, failed, skipped, split, inputs, fingerprint); rows,
            file, bytes, sha256 and digest are added here.
        redo : replace the part even if it is there with the same fingerprint. Otherwise another
            run was faster, and what it wrote stays.

        Returns the whole receipt of what is there now.
        """
        tables.check(self.description()["schema"], table)
        data = encoded(table)
        sha256 = hashlib.sha256(data).hexdigest()
        name = f"part-{number:05d}-{sha256[:12]}.parquet"
        full = {
            **receipt,
            "part": number,
            "rows": len(table),
            "file": name,
            "bytes": len(data),
            "sha256": sha256,
            "digest": tables.digest(table),
        }
        there = self._find(number)
        if there and there.get("fingerprint") == full.get("fingerprint") and not redo:
            return there
        self.store.write(f"{self.path}/{name}", data)
        failpoint("receipt")
        if there:
            self.store.delete(f"{self.path}/manifest.json")
            self.store.write(self._receipt_path(number), to_json(full))
            if there["file"] != name:
                self.store.delete(f"{self.path}/{there['file']}")
        elif not self.store.create(self._receipt_path(number), to_json(full)):
            there = self.receipt(number)
            if there["file"] != name:
                self.store.delete(f"{self.path}/{name}")
            if there.get("fingerprint") != full.get("fingerprint"):
                raise TransientError(
                    f"{self}: another run has just written part {number}, from another input. Let "
                    "one of them end, then run the same command again"
                )
            return there
        failpoint("committed")
        if self.store.size(f"{self.path}/{name}") is None:
            # Another run took it for a leftover before the receipt was there.
            self.store.write(f"{self.path}/{name}", data)
        return full

    def start_over(self) -> None:
        """Deletes the table: receipts first, so that a kill half-way leaves nothing half-valid."""
        names = self.store.list(self.path)
        self.store.delete(f"{self.path}/manifest.json")
        for ending in (".json", ".parquet"):
            for name in names:
                if name.startswith("part-") and name.endswith(ending):
                    self.store.delete(f"{self.path}/{name}")
        self.store.delete(f"{self.path}/local.json")
        self.store.delete(f"{self.path}/table.json")
        self.store.sweep(self.path)
