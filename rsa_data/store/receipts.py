"""Receipts: which parts of a table are done, and what each of them holds.

A receipt such as `_part-00007.json` names the part's file of data, which is named by its own
sha256; a file that no receipt names beside one that a receipt does is a leftover. Once every part
is done `_manifest.json` holds all receipts, in one file.

Names of helper files begin with an underscore, so that Arrow leaves them out when it opens the
folder. Tables of version 0.1 have the same names without it, and keep them until they are started
over: what reads and writes them asks `Receipts.helper` for the name.
"""

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor

import msgspec

from ..common.errors import RowError, RsaDataError
from ..common.failpoints import failpoint
from ..common.prefetch import ahead
from ..common.typed import parse
from .stores import Store
from .structures import Manifest, Receipt

TABLE, MANIFEST, LOCAL = "table.json", "manifest.json", "local.json"

_RECEIPT = re.compile(r"(_?)part-(\d{5,})\.json")
_DATA = re.compile(r"part-(\d{5,})-[0-9a-f]{12}\.parquet")
_COUNTS = ("rows", "bytes", "ok", "failed", "skipped")


def is_table(names: Iterable[str]) -> bool:
    """Whether the files of a folder are those of a table."""
    return not {"_" + TABLE, TABLE}.isdisjoint(names)


class Receipts:
    """The receipts of one table, and the manifest that merges them."""

    def __init__(self, store: Store, path: str):
        self.store, self.path = store, path
        self._start: str | None = None

    def __str__(self) -> str:
        return f"{self.store.location}/{self.path}"

    def helper(self, name: str) -> str:
        """The path of a helper file: `_table.json`, or `table.json` in a table of version 0.1."""
        return f"{self.path}/{self._prefix()}{name}"

    def _prefix(self) -> str:
        if self._start is None:
            if self.store.size(f"{self.path}/_{TABLE}") is not None:
                self._start = "_"
            elif self.store.size(f"{self.path}/{TABLE}") is not None:
                self._start = ""
        # Not kept while there is no table: another run may begin it.
        return "_" if self._start is None else self._start

    def parts(self) -> list[int]:
        """Numbers of the parts that are done, ascending."""
        start = self._prefix()
        found = (_RECEIPT.fullmatch(name) for name in self.store.list(self.path))
        return sorted(int(match[2]) for match in found if match and match[1] == start)

    def receipt(self, number: int) -> Receipt:
        """What a part holds and what it was made from; raises RsaDataError when it is not done."""
        receipt = self._find(number)
        if receipt is None:
            raise RsaDataError(f"{self}: part {number} is not done: it has no receipt")
        return receipt

    def _find(self, number: int) -> Receipt | None:
        path = self._receipt_path(number)
        if (data := self.store.read(path)) is None:
            return None
        try:
            return parse(data, Receipt, f"{self}: {path}")
        except RsaDataError as error:
            raise RsaDataError(f"{error}. Delete it to make the part again.") from error

    def receipts(self, numbers: Iterable[int]) -> Iterator[Receipt]:
        """The receipts of parts that are done, in the order of `numbers`.

        One after the other, since a table may have hundreds of thousands; read side by side where
        that pays.
        """
        if self.store.at_once == 1:
            yield from map(self.receipt, numbers)
            return
        with ThreadPoolExecutor(self.store.at_once) as pool:
            for receipt in ahead(pool, self.receipt, numbers, 4 * self.store.at_once):
                assert not isinstance(receipt, RowError)
                yield receipt

    def manifest(self, expected: list[int]) -> dict[str, int] | None:
        """Merges the receipts into _manifest.json once all `expected` parts are done.

        Returns what they add up to, or None when parts are missing. Also removes what runs that
        died have left in the folder.
        """
        self._sweep()
        done = self.parts()
        if done != expected:
            self.store.delete(self.helper(MANIFEST))
            return None
        total, lines = Counter[str](), []
        for receipt in self.receipts(done):
            total.update({key: getattr(receipt, key) for key in _COUNTS})
            plain = msgspec.to_builtins(receipt)
            lines.append(json.dumps(plain, sort_keys=True, ensure_ascii=False).encode())
        head = json.dumps({key: total[key] for key in _COUNTS}).removesuffix("}").encode()
        data = b"".join([head, b', "parts": [\n', b",\n".join(lines), b"\n]}\n"])
        if self.store.read(self.helper(MANIFEST)) != data:
            failpoint("manifest")
            self.store.write(self.helper(MANIFEST), data)
        failpoint("manifested")
        return {key: total[key] for key in _COUNTS}

    def stored_manifest(self) -> Manifest | None:
        """_manifest.json as it lies there, or None when the table is not finished."""
        path = self.helper(MANIFEST)
        if (data := self.store.read(path)) is None:
            return None
        try:
            return parse(data, Manifest, f"{self.store.location}/{path}")
        except RsaDataError as error:
            raise RsaDataError(f"{error}. Run the stage again") from error

    def complete(self) -> bool:
        """Whether the table has been finished; an index that was stopped half-way has not."""
        return self.store.size(self.helper(MANIFEST)) is not None

    def leftovers(self, files: Iterable[str]) -> list[str]:
        """Names in the table's folder that are neither helper files nor `files`, its data."""
        start, known = self._prefix(), {*files}
        helpers = () if start else (TABLE, MANIFEST, LOCAL)
        return [
            name
            for name in self.store.list(self.path)
            if name not in known
            and name not in helpers
            and not name.endswith("/")
            and not name.startswith("_")
            and (start or not _RECEIPT.fullmatch(name))
        ]

    def _sweep(self) -> None:
        """Removes data that no receipt names, beside one that names other data."""
        self.store.sweep(self.path)
        names = self.store.list(self.path)
        data: dict[int, list[str]] = {}
        for name in names:
            if match := _DATA.fullmatch(name):
                data.setdefault(int(match[1]), []).append(name)
        for number, files in data.items():
            if len(files) > 1 and (receipt := self._find(number)):
                for name in files:
                    if name != receipt.file:
                        self.store.delete(f"{self.path}/{name}")

    def _receipt_path(self, number: int) -> str:
        return self.helper(f"part-{number:05d}.json")
