"""A work dir as a notebook reads it: `open_work("work")["nyuv2"]["captions/occupancy"]`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from ..common import calls
from ..common.errors import RsaDataError, UsageError, unknown
from ..store import schemas
from ..store.tables import Table, WorkDir

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow.dataset

# Columns of binary values that are float16 arrays.
_HALVES = ("relative", "metric")


class OpenTable:
    """One table of a work dir, such as captions/occupancy."""

    def __init__(self, table: Table, samples: Table):
        self._table, self._samples = table, samples

    def __repr__(self) -> str:
        return f"<table {self._table}: {len(self._table.parts())} parts>"

    def to_arrow(self, *, partial: bool = False) -> pa.Table:
        """All rows, in the order of the samples.

        Raises RsaDataError when parts are not done yet, unless `partial` is given.
        """
        done = self._numbers(partial)
        return pa.concat_tables([self._table.read(number) for number in done])

    def to_pandas(self, *, partial: bool = False) -> pd.DataFrame:
        """The same as a DataFrame; features and depth become numpy arrays, one a row.

        embedding : (dim,), as stored. relative, metric : float16 (k,), or (height, width) where the
        row holds a whole map.
        """
        table = self.to_arrow(partial=partial)
        frame = table.to_pandas()
        if "embedding" in table.column_names:
            dtype = schemas.embedding_array(table.slice(0, 0)).dtype
            frame["embedding"] = [_array(v, dtype) for v in frame["embedding"]]
        for name in set(_HALVES) & set(table.column_names):
            maps = zip(frame[name], frame["kind"], frame["height"], frame["width"], strict=True)
            frame[name] = [
                _array(v, "<f2", (int(h), int(w)) if kind == "map" else None)
                for v, kind, h, w in maps
            ]
        return frame

    def to_numpy(self, *, partial: bool = False) -> np.ndarray:
        """The features of an embeddings table, (n, dim), as stored.

        Raises UsageError for a table without features, or with rows that have none.
        """
        table = self.to_arrow(partial=partial)
        if "embedding" not in table.column_names or table["embedding"].null_count:
            raise UsageError(f"{self._table}: expected a feature in every row; use to_pandas")
        return schemas.embedding_array(table)

    def dataset(self, *, partial: bool = False) -> pyarrow.dataset.Dataset:
        """The same as a pyarrow dataset: filters and columns are pushed down into the files."""
        import pyarrow.dataset

        done = self._numbers(partial)
        folder = Path(self._table.store.location)
        if not folder.is_dir():
            return pyarrow.dataset.dataset(self.to_arrow(partial=partial))
        files = [folder / self._table.path / self._table.receipt(n).file for n in done]
        return pyarrow.dataset.dataset([str(file) for file in files])

    def _numbers(self, partial: bool) -> list[int]:
        done, wanted = self._table.parts(), self._samples.parts()
        missing = sorted(set(wanted) - set(done))
        if missing and not partial:
            raise RsaDataError(
                f"{self._table}: {len(missing)} of {len(wanted)} parts are not done, such as "
                f"{missing[0]}. Run the command of its stage again, or give partial=True"
            )
        if not done:
            raise RsaDataError(f"{self._table}: no part is done yet")
        return done


class OpenDataset(Mapping[str, OpenTable]):
    """The tables of one dataset, by name."""

    def __init__(self, work: WorkDir, name: str):
        self._work, self._name = work, name

    def __getitem__(self, table: str) -> OpenTable:
        found = self._work.table(self._name, table)
        if not found.exists():
            raise unknown(f"table of {self._name}", table, self)
        return OpenTable(found, self._work.table(self._name, "samples"))

    def __iter__(self) -> Iterator[str]:
        return iter(self._work.tables(self._name))

    def __len__(self) -> int:
        return len(self._work.tables(self._name))

    def __repr__(self) -> str:
        return f"<dataset {self._name}: {', '.join(self)}>"


class OpenWork(Mapping[str, OpenDataset]):
    """The datasets of a work dir, by name."""

    def __init__(self, work: WorkDir):
        self._work = work

    def __getitem__(self, dataset: str) -> OpenDataset:
        if dataset not in self._work.datasets():
            raise unknown("dataset in this work dir", dataset, self)
        return OpenDataset(self._work, dataset)

    def __iter__(self) -> Iterator[str]:
        return iter(self._work.datasets())

    def __len__(self) -> int:
        return len(self._work.datasets())

    def __repr__(self) -> str:
        return f"<work dir {self._work.store.location}: {', '.join(self)}>"


def open_work(location: str | os.PathLike[str]) -> OpenWork:
    """Opens a work dir for reading: `open_work("work")["nyuv2"]["captions/occupancy"].to_pandas()`.

    location : a folder, or the address of an object store such as s3://bucket/prefix.

    Raises RsaDataError when it holds no dataset.
    """
    return OpenWork(open_dir(location))


def open_dir(location: WorkDir | str | os.PathLike[str]) -> WorkDir:
    """A work dir with at least one dataset in it; raises RsaDataError for any other place."""
    if not isinstance(location, WorkDir):
        calls.path("work", location)
        location = WorkDir(os.fspath(location))
    if not location.datasets():
        raise RsaDataError(
            f"{location.store.location}: expected a work dir; found no dataset in it"
        )
    return location


def _array(value: bytes | None, dtype: Any, shape: tuple[int, int] | None = None) -> Any:
    if value is None:
        return None
    found = np.frombuffer(value, dtype)
    return found.reshape(shape) if shape is not None else found
