"""Receipts: which parts of a table are done, and what each of them holds.

A receipt such as `part-00007.json` names the part's file of data, which is named by its own sha256;
a file that no receipt names beside one that a receipt does is a leftover. Once every part is done
`manifest.json` holds all receipts, in one file.
"""

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from ..common import forms
from ..common.errors import RowError, RsaDataError
from ..common.prefetch import ahead
from .failpoints import failpoint
from .stores import Store

_RECEIPT = re.compile(r"part-(\d{5,})\.json")
_DATA = re.compile(r"part-(\d{5,})-[0-9a-f]{12}\.parquet")
_COUNTS = ("rows", "bytes", "ok", "failed", "skipped")
_FORM = dict.fromkeys(("part", *_COUNTS), "a count") | {
    "file": "a file's name",
    "sha256": "text",
    "digest": "text",
    "fingerprint?": "text",
    "split?": "text",
    "inputs?": {"*": "text"},
}


class Receipts:
    """The receipts of one table, and the manifest that merges them."""

    def __init__(self, store: Store, path: str):
        self.store, self.path = store, path

    def __str__(self) -> str:
        return f"{self.store.location}/{self.path}"

    def parts(self) -> list[int]:
        """Numbers of the parts that are done, ascending."""
        names = self.store.list(self.path)
        return sorted(int(m[1]) for name in names if (m := _RECEIPT.fullmatch(name)))

    def receipt(self, number: int) -> dict[str, Any]:
        """What a part holds and what it was made from; raises RsaDataError when it is not done."""
        receipt = self._find(number)
        if receipt is None:
            raise RsaDataError(f"{self}: part {number} is not done: it has no receipt")
        return receipt

    def _find(self, number: int) -> dict[str, Any] | None:
        if (data := self.store.read(self._receipt_path(number))) is None:
            return None
        where = f"{self}: {self._receipt_path(number)}"
        try:
            found = forms.check(json.loads(data), _FORM, where)
        except (ValueError, RecursionError, RsaDataError) as error:
            known = isinstance(error, RsaDataError)
            what = error if known else f"{where}: expected a receipt, found {data!r:.60}"
            raise RsaDataError(f"{what}. Delete it to make the part again.") from error
        return found

    def receipts(self, numbers: Iterable[int]) -> Iterator[dict[str, Any]]:
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
        """Merges the receipts into manifest.json once all `expected` parts are done.

        Returns what they add up to, or None when parts are missing. Also removes what runs that
        died have left in the folder.
        """
        self._sweep()
        done = self.parts()
        if done != expected:
            self.store.delete(f"{self.path}/manifest.json")
            return None
        total, lines = Counter[str](), []
        for receipt in self.receipts(done):
            total.update({key: receipt[key] for key in _COUNTS})
            lines.append(json.dumps(receipt, sort_keys=True, ensure_ascii=False).encode())
        head = json.dumps({key: total[key] for key in _COUNTS}).removesuffix("}").encode()
        data = b"".join([head, b', "parts": [\n', b",\n".join(lines), b"\n]}\n"])
        if self.store.read(f"{self.path}/manifest.json") != data:
            failpoint("manifest")
            self.store.write(f"{self.path}/manifest.json", data)
        failpoint("manifested")
        return {key: total[key] for key in _COUNTS}

    def stored_manifest(self) -> dict[str, Any] | None:
        """manifest.json as it lies there, or None when the table is not finished."""
        data = self.store.read(f"{self.path}/manifest.json")
        if data is None:
            return None
        try:
            return forms.check(json.loads(data), {"parts": [_FORM]}, f"{self}: manifest.json")
        except (ValueError, RecursionError) as error:
            raise RsaDataError(
                f"{self}: manifest.json: expected JSON, found {data!r:.60}. Run the stage again"
            ) from error

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
