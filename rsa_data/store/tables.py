"""Tables that appear part by part, are found whole or not at all.

A table is a folder with `_table.json` (what made it, created once), files of data such as
`part-00007-1f0c2ab34d5e.parquet`, and receipts such as `_part-00007.json`. A file of data is named
by its own sha256 and never changed; the receipt names it, and its appearance is the commit, on a
file system as on S3. So two runs at once cannot mix, and a part without a receipt is not done.
Nothing that depends on time, host or worker stands in any of them: the same work, the same bytes.
"""

import hashlib
import shlex
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq

from ..common.errors import RsaDataError, TransientError
from ..common.failpoints import failpoint
from ..common.typed import parse
from . import schemas as tables
from .encoding import differences, encoded, short
from .encoding import fingerprint as fingerprint
from .encoding import to_json as to_json
from .receipts import LOCAL, MANIFEST, TABLE, Receipts, is_table
from .stores import open_store
from .structures import Description as Description
from .structures import Made as Made
from .structures import Receipt as Receipt
from .structures import T
from .table_names import check_plain


class WorkDir:
    """A work dir: every table of every dataset, and the heads."""

    def __init__(self, location: str | Path):
        self.store = open_store(location)

    @property
    def option(self) -> str:
        """What a suggested command needs behind it to find this work dir: ` --work PLACE`."""
        where = self.store.location
        return "" if where == "work" else f" --work {shlex.quote(where)}"

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
            if is_table(names):
                found.append(folder.rstrip("/"))
            folders += [folder + name for name in names if name.endswith("/")]
        return sorted(found)

    def table(self, dataset: str, name: str) -> "Table":
        """One table, whether it exists yet or not. Raises UsageError for impossible names."""
        check_plain("dataset", dataset)
        return Table(self, dataset, name)


class Table(Receipts):
    """The parts of one table."""

    def __init__(self, work: WorkDir, dataset: str, name: str):
        super().__init__(work.store, f"{dataset}/{name}")
        self.dataset, self.name = dataset, name
        self._readable = False

    def exists(self) -> bool:
        """Whether the table has been begun."""
        return self.store.size(self.helper(TABLE)) is not None

    def description(self) -> Description:
        """What made the table; raises RsaDataError when it has not been begun."""
        return self.described(Description)

    def described(self, kind: type[T]) -> T:
        """The same as another structure, which stands in the place of a Description."""
        path = self.helper(TABLE)
        if (data := self.store.read(path)) is None:
            raise RsaDataError(f"{self}: no such table. Tables there: {self._neighbours()}")
        try:
            return parse(data, kind, f"{self.store.location}/{path}")
        except RsaDataError as error:
            raise RsaDataError(f"{error}. --start-over makes the table again") from error

    def missing(self) -> list[int]:
        """Numbers of the samples' parts that are not done in this table."""
        samples = Receipts(self.store, f"{self.dataset}/samples")
        return sorted(set(samples.parts()) - set(self.parts()))

    def remember(self, values: dict[str, Any]) -> None:
        """Keeps where a run found its files, in _local.json; no part depends on it."""
        self.store.write(self.helper(LOCAL), to_json(values))

    def remembered(self) -> dict[str, Any]:
        """What the last run left by `remember`; {} when it is missing or damaged."""
        try:
            return parse(self.store.read(self.helper(LOCAL)) or b"{}", dict[str, Any], LOCAL)
        except RsaDataError:
            return {}

    def _neighbours(self) -> str:
        work = WorkDir.__new__(WorkDir)
        work.store = self.store
        return ", ".join(work.tables(self.dataset)) or "none"

    def read(
        self,
        number: int,
        columns: list[str] | None = None,
        *,
        receipt: Receipt | None = None,
        check: bool = False,
    ) -> pa.Table:
        """One part. Raises RsaDataError when it is not done or not what its receipt says.

        receipt : of the part, when the caller has it: these bytes, even if another run has
            replaced the part since. check : also hold the sha256 of the file against it.
        """
        if not self._readable:
            about = self.description()
            tables.check_version(about.schema, about.schema_version, str(self))
            self._readable = True
        wanted = receipt or self.receipt(number)
        path = f"{self.path}/{wanted.file}"
        size = self.store.size(path)
        if size is None and receipt is None and (newer := self.receipt(number)) != wanted:
            return self.read(number, columns, receipt=newer, check=check)
        if size != wanted.bytes:
            found = "no file" if size is None else f"{size} bytes"
            mend = "Run `rsa-data verify`; delete the receipt to make the part again"
            mend = "Run the command of this table again to make it" if size is None else mend
            raise RsaDataError(
                f"{self}: part {number}: expected {wanted.bytes} bytes, as its receipt says; "
                f"found {found}. {mend}"
            )
        try:
            with self.store.open(path) as file:
                if check:
                    found = hashlib.sha256(file.read_buffer()).hexdigest()
                    if found != wanted.sha256:
                        raise pa.ArrowInvalid(
                            f"expected sha256 {wanted.sha256[:12]}..., found {found[:12]}..."
                        )
                    file.seek(0)
                return pq.read_table(file, columns=columns, use_threads=False)
        except (pa.ArrowException, OSError) as error:
            raise RsaDataError(
                f"{self}: part {number} cannot be read: {error}. Run `rsa-data verify`; delete its "
                "receipt to make it again."
            ) from error

    def bind(self, description: msgspec.Struct) -> None:
        """Begins the table, or checks that what made it is what would continue it.

        description : a Description, or the structure that stands in its place for heads.
        Raises RsaDataError naming each difference; `made_with` is for information only. Without any
        part it is begun anew, and a run that is at its first part sees that before it commits.
        """
        self.store.sweep(self.path)
        self.store.create(self.helper(TABLE), to_json(description))
        there = self.described(type(description))
        different = [
            f"{where}: the table has {short(old)}, this run has {short(new)}"
            for where, old, new in differences(
                msgspec.to_builtins(there), msgspec.to_builtins(description)
            )
            if not where.startswith("made_with")
        ]
        if different and isinstance(description, Description) and not self.parts():
            self.start_over()
            self.store.create(self.helper(TABLE), to_json(description))
        elif different:
            raise RsaDataError(
                f"{self} was made with other options. " + "; ".join(different) + ". Use the same "
                "options, another --work, or --start-over to delete this table and make it again."
            )

    def commit(self, number: int, table: pa.Table, made: Made, *, redo: bool = False) -> Receipt:
        """Writes a part, then its receipt: from then on the part is done.

        redo : replace the part even if it is there with the same fingerprint. Otherwise another
            run was faster, and what it wrote stays.

        Returns the receipt of what is there now.
        """
        tables.check(self.description().schema, table)
        data = encoded(table)
        sha256 = hashlib.sha256(data).hexdigest()
        name = f"part-{number:05d}-{sha256[:12]}.parquet"
        full = Receipt(
            **{field: getattr(made, field) for field in Made.__struct_fields__},
            part=number,
            rows=len(table),
            file=name,
            bytes=len(data),
            sha256=sha256,
            digest=tables.digest(table),
        )
        there = self._find(number)
        if there and there.fingerprint == full.fingerprint and not redo:
            return there
        self.store.write(f"{self.path}/{name}", data)
        failpoint("receipt")
        if there:
            self.store.delete(self.helper(MANIFEST))
            self.store.write(self._receipt_path(number), to_json(full))
            if there.file != name:
                self.store.delete(f"{self.path}/{there.file}")
        elif not self.store.create(self._receipt_path(number), to_json(full)):
            there = self.receipt(number)
            if there.file != name:
                self.store.delete(f"{self.path}/{name}")
            if there.fingerprint != full.fingerprint:
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
        self.store.delete(self.helper(MANIFEST))
        for ending in (".json", ".parquet"):
            for name in names:
                if name.removeprefix("_").startswith("part-") and name.endswith(ending):
                    self.store.delete(f"{self.path}/{name}")
        self.store.delete(self.helper(LOCAL))
        self.store.delete(self.helper(TABLE))
        self._start = None
        self.store.sweep(self.path)

    def forget_manifest(self) -> None:
        """Says that the table is not finished any more: parts are about to be added."""
        self.store.delete(self.helper(MANIFEST))
