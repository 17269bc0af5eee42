"""Receipts: which parts of a table are done, and what each of them holds.

A receipt such as `part-00007.json` names the part's file of data, which is named by its own sha256;
a file that no receipt names beside one that a receipt does is a leftover. Once every part is done
`manifest.json` holds all receipts, in one file.
"""

import json
import re
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from .canonical import to_json
from .errors import RsaDataError
from .storage import Store, failpoint

_RECEIPT = re.compile(r"part-(\d{5,})\.json")
_DATA = re.compile(r"part-(\d{5,})-[0-9a-f]{12}\.parquet")
_COUNTS = ("rows", "bytes", "ok", "failed", "skipped")


class Receipts:
    """The receipts of one table, and the manifest that merges them."""

    def __init__(self, store: Store, path: str):
        self.store, self.path = store, path

    def __str__(self) -> str:
        return f"{self.store.location}/{self.path}"

    def parts(self) -> list[int]:
        """Numbers of the parts that are done, ascending."""
        return [int(m[1]) for name in self.store.list(self.path) if (m := _RECEIPT.fullmatch(name))]

    def receipt(self, number: int) -> dict[str, Any]:
        """What a part holds and what it was made from; raises RsaDataError when it is not done."""
        receipt = self._find(number)
        if receipt is None:
            raise RsaDataError(f"{self}: part {number} is not done: it has no receipt")
        return receipt

    def _find(self, number: int) -> dict[str, Any] | None:
        data = self.store.read(self._receipt_path(number))
        try:
            return None if data is None else json.loads(data)
        except ValueError as error:
            raise RsaDataError(
                f"{self}: {self._receipt_path(number)}: expected a receipt, found {data!r:.60}. "
                "Delete it to make the part again."
            ) from error

    def receipts(self, numbers: list[int]) -> dict[int, dict[str, Any]]:
        """The receipts of parts that are done, by number; read side by side where that pays."""
        if self.store.at_once == 1:
            return {number: self.receipt(number) for number in numbers}
        with ThreadPoolExecutor(self.store.at_once) as pool:
            return dict(zip(numbers, pool.map(self.receipt, numbers), strict=True))

    def manifest(self, expected: list[int]) -> dict[str, Any] | None:
        """Merges the receipts into manifest.json once all `expected` parts are done, else None.

        Also removes what runs that died have left in the folder.
        """
        self._sweep()
        done = self.parts()
        if done != expected:
            self.store.delete(f"{self.path}/manifest.json")
            return None
        receipts = list(self.receipts(done).values())
        total = {key: sum(r[key] for r in receipts) for key in _COUNTS}
        merged = {**total, "parts": receipts}
        data = to_json(merged)
        if self.store.read(f"{self.path}/manifest.json") != data:
            failpoint("manifest")
            self.store.write(f"{self.path}/manifest.json", data)
        failpoint("manifested")
        return merged

    def stored_manifest(self) -> dict[str, Any] | None:
        """manifest.json as it lies there, or None when the table is not finished."""
        data = self.store.read(f"{self.path}/manifest.json")
        return None if data is None else json.loads(data)

    def complete(self) -> bool:
        """Whether the table has been finished; an index that was stopped half-way has not."""
        return self.store.size(f"{self.path}/manifest.json") is not None

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
                    if name != receipt["file"]:
                        self.store.delete(f"{self.path}/{name}")

    def _receipt_path(self, number: int) -> str:
        return f"{self.path}/part-{number:05d}.json"
